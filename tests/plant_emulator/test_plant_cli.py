"""The command line: its output, and one clear line for every mistake."""

from __future__ import annotations

import csv
import io
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from plant_emulator.cli.main import main
from plant_emulator.presets import plant_settings, preset_names
from positioner import __version__
from positioner.errors import ExitCode
from positioner.machine.build import version

if TYPE_CHECKING:
    from pathlib import Path

    Output = pytest.CaptureFixture[str]


def rows_of(text: str) -> list[dict[str, float]]:
    return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(io.StringIO(text))]


def test_simulate_writes_one_row_per_period_and_the_start(capsys: Output) -> None:
    assert main(["simulate", "--input", "step", "--duration", "0.2", "--low-ma", "4", "--high-ma", "9"]) == 0
    rows = rows_of(capsys.readouterr().out)
    assert list(rows[0]) == ["time_s", "current_ma", "pressure_pa", "position_m", "velocity_m_per_s", "friction_n"]
    assert [row["time_s"] for row in rows] == pytest.approx([index * 0.001 for index in range(201)])
    assert rows[0]["position_m"] == 0.01
    assert {row["current_ma"] for row in rows[1:21]} == {4.0}
    assert {row["current_ma"] for row in rows[21:]} == {9.0}
    assert rows[-1]["pressure_pa"] == pytest.approx(9.0 * 5171.06775)
    assert rows[-1]["position_m"] > 0.02


@pytest.mark.parametrize("preset", ["paper", "graphite", "stochastic"])
@pytest.mark.parametrize("lag_s", [0.0, 0.1])
def test_every_row_lies_within_the_waveform(preset: str, lag_s: float, capsys: Output) -> None:
    lag = ["--set", f"actuator.fill_time_constant_s={lag_s}", "--set", f"actuator.vent_time_constant_s={lag_s}"]
    assert main(["simulate", "--preset", preset, *lag, "--duration", "0.5", "--low-ma", "6", "--high-ma", "8"]) == 0
    rows = rows_of(capsys.readouterr().out)
    gain_pa_per_ma = plant_settings(preset).valve.pressure_gain_pa_per_ma
    for row in rows:
        assert 6.0 <= row["current_ma"] <= 8.0
        assert 6.0 - 1e-9 <= row["pressure_pa"] / gain_pa_per_ma <= 8.0 + 1e-9
    assert (rows[0]["time_s"], rows[0]["current_ma"], rows[0]["velocity_m_per_s"]) == (0.0, 6.0, 0.0)


def test_the_stem_is_held_at_the_start_by_friction(capsys: Output) -> None:
    # B u - K x at 10 mm: within F_s at 4 mA, beyond it at 10 mA
    for low_ma, held_n in (("4", 4.0 * 333.637 - 525.38), ("10", 1707.7)):
        assert main(["simulate", "--duration", "0.01", "--low-ma", low_ma]) == 0
        assert rows_of(capsys.readouterr().out)[0]["friction_n"] == pytest.approx(held_n, rel=1e-4)


def test_the_triangle_goes_up_and_back_and_the_ramp_only_up(capsys: Output) -> None:
    arguments = ["--duration", "1", "--period", "0.25", "--low-ma", "4", "--high-ma", "12"]
    assert main(["simulate", "--input", "triangle", *arguments]) == 0
    assert [row["current_ma"] for row in rows_of(capsys.readouterr().out)[1:]] == [4.0, 8.0, 12.0, 8.0]
    assert main(["simulate", "--input", "ramp", *arguments]) == 0
    assert [row["current_ma"] for row in rows_of(capsys.readouterr().out)[1:]] == [4.0, 6.0, 8.0, 10.0]


def test_the_preset_the_plant_file_and_single_changes_reach_the_valve(tmp_path: Path, capsys: Output) -> None:
    plant = tmp_path / "plant.toml"
    plant.write_text('preset = "frictionless"\n[valve]\ninitial_position_m = 0.03\n', encoding="utf-8")
    out = tmp_path / "motion.csv"
    assert main(["simulate", "--config", str(plant), "--set", "valve.bench_set_n=100", "--set", "fail_position=open",
                 "--input", "step", "--duration", "1", "--high-ma", "10", "--out", str(out)]) == 0  # fmt: skip
    rows = rows_of(out.read_text(encoding="utf-8"))
    assert rows[0]["position_m"] == 0.03
    gain_n_per_ma = 0.06452 * 5171.06775
    assert rows[-1]["position_m"] == pytest.approx((10.0 * gain_n_per_ma - 100.0) / 52538.0, abs=1e-9)
    assert capsys.readouterr().out == ""
    assert main(["simulate", "--preset", "graphite", "--duration", "0.001"]) == 0
    assert rows_of(capsys.readouterr().out)[0]["position_m"] == 0.015


def test_a_seed_repeats_a_stochastic_valve(capsys: Output) -> None:
    def text(seed: str) -> str:
        arguments = ["--preset", "stochastic", "--input", "step", "--duration", "0.1", "--high-ma", "9"]
        assert main(["simulate", *arguments, "--seed", seed]) == 0
        return capsys.readouterr().out

    assert text("1") == text("1")
    assert text("1") != text("2")


def test_a_current_file_is_held_from_row_to_row(tmp_path: Path, capsys: Output) -> None:
    currents = tmp_path / "currents.csv"
    currents.write_text("time_s,note,current_ma\n0,a,5\n0.002,b,7\n0.004,c,6\n", encoding="utf-8")
    assert main(["simulate", "--input", str(currents)]) == 0
    assert [row["current_ma"] for row in rows_of(capsys.readouterr().out)[1:]] == [5.0, 5.0, 7.0, 7.0]
    assert main(["simulate", "--input", str(currents), "--duration", "0.006"]) == 0
    assert [row["current_ma"] for row in rows_of(capsys.readouterr().out)[1:]] == [5.0, 5.0, 7.0, 7.0, 6.0, 6.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,current_ma\n0,4\n0.1,x\n", "line 3: current_ma = 'x': is not a number; write it like 12.5"),
        ("time_s,current_ma\n0,4\n0.1\n", "line 3: current_ma = '': is not a number; write it like 12.5"),
        ("time_s,current_ma\n0,4\nnan,5\n", "line 3: time_s = 'nan': is not a number; write it like 12.5"),
        ("time_s,current_ma\n0,4\n1,26\n", "line 3: current_ma = 26: must be from 0 to 25 mA"),
        ("time_s,current_ma\n0,4\n1,-1\n", "line 3: current_ma = -1: must be from 0 to 25 mA"),
        ("time_s,current_ma\n1,4\n1,5\n", "line 3: time_s = 1: must be 0 or more, and later than the row before"),
        ("time_s,current_ma\n-1,4\n1,5\n", "line 2: time_s = -1: must be 0 or more"),
        ("time,current_ma\n0,4\n", "line 1: header: has no column time_s; write the header time_s,current_ma"),
        ("", "line 1: header: has no column time_s"),
        ("time_s,current_ma\n0,4\n", "file: holds fewer than two rows"),
    ],
)
def test_a_bad_row_is_reported_with_file_row_and_fix(text: str, message: str, tmp_path: Path, capsys: Output) -> None:
    currents = tmp_path / "currents.csv"
    currents.write_text(text, encoding="utf-8")
    assert main(["simulate", "--input", str(currents)]) == ExitCode.CONFIG
    error = capsys.readouterr().err
    assert error.startswith(f"plant-emulator: {currents}: {message}")
    assert error.count("\n") == 1


def test_a_current_file_that_is_no_text_is_reported(tmp_path: Path, capsys: Output) -> None:
    currents = tmp_path / "currents.csv"
    currents.write_bytes(b"\xff\xfe\x00")
    assert main(["simulate", "--input", str(currents)]) == ExitCode.CONFIG
    assert capsys.readouterr().err == f"plant-emulator: {currents}: file: cannot be read: is not UTF-8 text\n"


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["--set", "valve.mass_kg=1361"], ExitCode.CONFIG, "valve.mass_kg = 1361: must be less than or equal to 200"),
        (["--set", "valve.mas_kg=1"], ExitCode.CONFIG, "valve.mas_kg: unknown key; did you mean 'mass_kg'?"),
        (["--set", "valve.mass_kg"], ExitCode.CONFIG, "is no KEY=VALUE; write it like valve.mass_kg=2"),
        (["--set", "fail_position=ajar"], ExitCode.CONFIG, "must be 'close', 'open', 'hold' or 'current'"),
        (["--set", "a b=1"], ExitCode.CONFIG, "--set: line 1: TOML"),
        (["--config", "absent.toml"], ExitCode.CONFIG, "absent.toml: file: cannot be read: No such file or directory"),
        (["--input", "absent.csv"], ExitCode.CONFIG, "absent.csv: file: cannot be read: No such file or directory"),
        (
            ["--duration", "0.001", "--out", "absent/x.csv"],
            ExitCode.IO,
            "absent/x.csv: cannot be written: No such",
        ),
    ],
)
def test_a_mistake_gives_one_line_and_its_exit_status(
    arguments: list[str],
    status: ExitCode,
    message: str,
    capsys: Output,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", *arguments]) == status
    error = capsys.readouterr().err
    assert error.startswith("plant-emulator: ")
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["simulate", "--period", "0"], "argument --period: '0' is not seconds from 1e-6 to 1e6"),
        (["simulate", "--duration", "long"], "argument --duration: 'long' is not seconds from 1e-6 to 1e6"),
        (["simulate", "--high-ma", "nan"], "argument --high-ma: 'nan' is not mA from 0 to 25"),
        (["simulate", "--seed", "-1"], "argument --seed: '-1' is no whole number of 0 or more"),
        (["simulate", "--preset", "papr"], "argument --preset: 'papr' is unknown; did you mean 'paper'?"),
        (["simulate", "--preset", "paper", "--config", "x.toml"], "not allowed with argument --preset"),
        (["tease"], "'tease' is unknown"),
        ([], "the following arguments are required: COMMAND"),
    ],
)
def test_a_wrong_command_line_is_refused(arguments: list[str], message: str, capsys: Output) -> None:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == ExitCode.USAGE
    assert message in capsys.readouterr().err


def test_presets_are_listed_with_their_descriptions(capsys: Output) -> None:
    assert main(["presets"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(preset_names())
    assert any(line.startswith("paper ") and "Table 3" in line for line in lines)


@pytest.mark.parametrize("command", [[], ["simulate"], ["presets"]])
def test_help_gives_an_example(command: list[str], capsys: Output) -> None:
    with pytest.raises(SystemExit) as end:
        main([*command, "--help"])
    assert end.value.code == 0
    assert "example" in capsys.readouterr().out


def test_the_version_is_printed(capsys: Output) -> None:
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capsys.readouterr().out == version("plant-emulator", __version__) + "\n"


def test_an_interrupt_ends_as_shells_expect(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted() -> tuple[str, ...]:
        raise KeyboardInterrupt

    monkeypatch.setattr("plant_emulator.cli.presets.preset_names", interrupted)
    assert main(["presets"]) == 130


def test_a_closed_pipe_is_no_error() -> None:
    command = f"{sys.executable} -m plant_emulator.cli.main simulate --duration 2 | head -n 2"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert len(done.stdout.splitlines()) == 2
    assert done.stderr == ""
