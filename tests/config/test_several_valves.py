"""A file with several valves: shared tables, own tables, mistakes with their lines, valves that clash."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from positioner.cli.main import main
from positioner.config.locations import location_of
from positioner.config.reader import load_config, load_valves
from positioner.errors import ConfigurationError, ExitCode, UsageError
from positioner.wire.messages import StemPosition

ROOT = Path(__file__).resolve().parents[2]
THREE = """\
[bus]
channel = "can1"

[control]
sample_period_s = 0.002
law = "pi"

[[valve]]
id = "FV-101"
preset = "paper"

[[valve]]
id = "FV-102"
preset = "graphite"
guard.auto_arm = true
[valve.wire]
id_offset = 128
[valve.control]
sample_period_s = 0.005

[[valve]]
id = "FV-103"
preset = "paper"
bus.channel = "can2"
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "plant.toml"
    path.write_text(text, encoding="utf-8")
    return path


def problems_of(folder: Path, text: str) -> list[str]:
    path = written(folder, text)
    with pytest.raises(ConfigurationError) as caught:
        load_valves(path)
    return [line.removeprefix(f"{path}: ") for line in str(caught.value).splitlines()]


def test_each_valve_has_the_shared_tables_with_its_own_laid_over_them(tmp_path: Path) -> None:
    first, second, third = load_valves(written(tmp_path, THREE))
    assert [each.valve.id for each in (first, second, third)] == ["FV-101", "FV-102", "FV-103"]
    assert [each.control.sample_period_s for each in (first, second, third)] == [0.002, 0.005, 0.002]
    assert {each.control.law for each in (first, second, third)} == {"pi"}
    assert [each.bus.channel for each in (first, second, third)] == ["can1", "can1", "can2"]
    assert [each.guard.auto_arm for each in (first, second, third)] == [False, True, False]
    assert [each.make_codec().identifier(StemPosition)[0] for each in (first, second, third)] == [0x110, 0x190, 0x110]
    assert second.valve.span_m == 0.025


def test_a_table_without_an_array_is_one_valve(tmp_path: Path) -> None:
    path = written(tmp_path, '[valve]\nid = "FV-101"\npreset = "paper"\n')
    assert load_valves(path) == (load_config(path),)


def test_each_valve_has_a_folder_of_its_own_in_the_state_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, THREE)
    second = load_valves(path)[1]
    monkeypatch.setenv("XDG_STATE_HOME", "/home/me/state")
    assert second.state_directory == Path("/home/me/state/positioner/FV-102")
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/positioner/plant")
    assert second.state_directory == Path("/var/lib/positioner/plant/FV-102")
    assert location_of(second, path).state == Path("/var/lib/positioner/plant/FV-102")
    monkeypatch.delenv("STATE_DIRECTORY")
    assert location_of(second, Path("/etc/positioner/plant.toml")).state == Path("/var/lib/positioner/plant/FV-102")
    assert location_of(second, path, Path("/given")).state == Path("/given/FV-102")
    kept = load_valves(written(tmp_path, f'state.directory = "kept"\n{THREE}'))
    assert [each.state_directory for each in kept] == [tmp_path / "kept" / f"FV-10{n}" for n in (1, 2, 3)]


def test_a_mistake_in_a_shared_table_is_told_once_and_one_of_a_valve_with_its_name_and_line(tmp_path: Path) -> None:
    text = THREE.replace('law = "pi"', 'law = "p"\nbeat = 1').replace("id_offset = 128", "id_offset = 129")
    text = text.replace('bus.channel = "can2"', 'bus.chanel = "can2"\nguard.max_jump_m = -1.0')
    assert [problem.partition(": ")[0] for problem in problems_of(tmp_path, text)] == [
        f"line {n}" for n in (6, 7, 18, 25, 26)
    ]
    law, beat, offset, channel, jump = problems_of(tmp_path, text)
    assert law.startswith("line 6: control.law = 'p': is no law; did you mean 'pi'?")
    assert beat.startswith("line 7: control.beat: unknown key")
    assert offset.startswith("line 18: valve FV-102: wire.id_offset = 129: ")
    assert channel == "line 25: valve FV-103: bus.chanel: unknown key; did you mean 'channel'?"
    assert jump.startswith("line 26: valve FV-103: guard.max_jump_m = -1.0: ")


def test_a_shared_value_that_does_not_fit_one_valve_names_that_valve(tmp_path: Path) -> None:
    text = THREE.replace("[bus]", "[guard]\ncurrent_low_ma = 6.0\n\n[bus]").replace(
        "guard.auto_arm = true", "guard.current_high_ma = 5.0"
    )
    (problem,) = problems_of(tmp_path, text)
    assert "valve FV-102: guard: " in problem


def test_a_mistake_in_the_parameters_of_a_valve_is_told_with_its_name(tmp_path: Path) -> None:
    text = THREE.replace('"graphite"', '"grafit"').replace('id = "FV-103"\n', "")
    preset, missing = problems_of(tmp_path, text)
    assert preset.startswith("line 14: valve FV-102: preset = 'grafit': is no valve; did you mean 'graphite'?")
    assert missing == "line 21: valve number 3: id: is required and missing"


def test_valves_on_one_bus_need_identifiers_of_their_own(tmp_path: Path) -> None:
    (problem,) = problems_of(tmp_path, THREE.replace("id_offset = 128", ""))
    expected = "line 16: valve FV-102: wire: CURRENT_COMMAND has the identifier 100 of FV-101's CURRENT_COMMAND on bus "
    assert problem == f"{expected}socketcan:can1; try wire.id_offset = 128"
    (problem,) = problems_of(tmp_path, THREE.replace("can2", "can1"))
    assert "FV-103: wire: CURRENT_COMMAND has the identifier 100 of FV-101's" in problem
    assert problem.endswith("try wire.id_offset = 256")


def test_valves_with_one_id_or_one_bus_with_two_sets_of_options_are_refused(tmp_path: Path) -> None:
    assert problems_of(tmp_path, THREE.replace("FV-103", "FV-101")) == [
        "line 22: valve FV-101: id: is another valve's: each needs its own, as its state does"
    ]
    text = THREE.replace("[valve.wire]", "bus.options.local_loopback = true\n[valve.wire]")
    assert problems_of(tmp_path, text) == [
        "line 16: valve FV-102: bus.options: differ from those of FV-101, which is on the same bus"
    ]


def test_a_file_with_no_valve_in_its_array_is_refused(tmp_path: Path) -> None:
    assert problems_of(tmp_path, "valve = []") == ["line 1: valve: has no valve: begin each one with [[valve]]"]
    assert problems_of(tmp_path, "valve = [1]") == ["line 1: valve = 1: must be an object"]


def test_a_relative_dbc_is_found_by_every_valve(tmp_path: Path) -> None:
    folder = tmp_path / "there"
    folder.mkdir()
    (folder / "mine.dbc").write_text('VERSION ""\nBU_: PLANT\nBO_ 512 A: 8 PLANT\n', encoding="utf-8")
    kept = load_valves(written(folder, f'wire.dbc = "mine.dbc"\n{THREE}'))
    assert {each.wire.dbc for each in kept} == {folder / "mine.dbc"}


def test_a_command_for_one_valve_asks_which(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, THREE)
    with pytest.raises(UsageError, match="has the valves FV-101, FV-102, FV-103: name one of them with --valve"):
        load_config(path)
    with pytest.raises(UsageError, match="did you mean 'FV-103'"):
        load_config(path, valve="FV-13")
    assert load_config(path, valve="FV-102").valve.id == "FV-102"
    assert load_config(path, {"control": {"law": "nmpc"}}, "FV-102").control.sample_period_s == 0.005
    assert load_config(path, {"control": {"law": "nmpc"}}, "FV-102").control.law == "nmpc"
    assert main(["host", "--config", str(path), "status"]) == ExitCode.USAGE
    assert (
        capsys.readouterr().err
        == f"positioner: {path} has the valves FV-101, FV-102, FV-103: name one of them with --valve\n"
    )


def test_check_shows_every_valve_and_the_load_of_a_shared_bus(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(written(tmp_path, THREE))]) == ExitCode.OK
    shown = capsys.readouterr().out
    assert [line.split()[1] for line in shown.splitlines() if line.startswith("valve ")] == [
        "FV-101,",
        "FV-102,",
        "FV-103,",
    ]
    # 1400 frames of samples and 420 others in a second, of 135 bits each with all stuff bits
    assert [line for line in shown.splitlines() if line.startswith("bus load of")] == [
        "bus load of socketcan:can1 with 2 valves: 25 % of 1 Mbit/s at most"
    ]
    assert main(["check", str(written(tmp_path, THREE)), "--json"]) == ExitCode.OK
    assert json.loads(capsys.readouterr().out)["warnings"] == []


def test_check_warns_of_a_shared_bus_that_carries_too_much_a_person_and_a_program(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, THREE.replace("0.002", "0.0004").replace("0.005", "0.0004"))
    assert main(["check", str(path)]) == ExitCode.OK
    shown = capsys.readouterr().out
    assert main(["check", str(path), "--json"]) == ExitCode.OK
    (warning,) = json.loads(capsys.readouterr().out)["warnings"]
    assert "socketcan:can1 with 2 valves" in warning
    assert f"- {warning}" in " ".join(shown.split())
