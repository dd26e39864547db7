"""own-law.md, own-plant.md, python-api.md of docs, and the examples: every snippet is executed as it stands there."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import positioner
from plant_emulator.cli.main import build_parser as plant_parser
from plant_emulator.own_physics import OwnPhysics
from plant_emulator.plants import plant_named
from positioner import diagnose, load_log
from positioner.bench.configure import configuration_text
from positioner.bench.inprocess import run_in_process
from positioner.bench.scenario import Scenario
from positioner.bench.sensor_noise import sensor_table
from positioner.bench.setpoints import setpoints_in
from positioner.bus.address import BusAddress
from positioner.cli.main import build_parser
from positioner.config.reader import parse_config
from positioner.diagnostics.verdict import Verdict
from positioner.errors import PositionerError
from positioner.studies.searches import search_of

ROOT = Path(__file__).resolve().parents[2]
OWN_LAW = (ROOT / "docs" / "own-law.md").read_text(encoding="utf-8")
OWN_PLANT = (ROOT / "docs" / "own-plant.md").read_text(encoding="utf-8")
API = (ROOT / "docs" / "python-api.md").read_text(encoding="utf-8")


def fenced(page: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page, flags=re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with `bus.log` and `valve.toml` of a sticking valve under `pi`."""
    folder = tmp_path_factory.mktemp("recorded")
    scenario = Scenario(
        name="own", title="own", law="pi", setpoints_mm=(62.0, 90.0, 62.0, 90.0, 62.0, 90.0), dwell_s=0.4,
        plant={"preset": "paper", "sensor": sensor_table("gaussian:0.02%")},
    )  # fmt: skip
    run_in_process(scenario).recording.write_log(folder / "bus.log")
    text = configuration_text(scenario, BusAddress(), Path("state"))
    (folder / "valve.toml").write_text(text, encoding="utf-8")
    return folder


@pytest.mark.parametrize("number", range(len(fenced(API, "python"))))
def test_a_snippet_of_the_page_runs_as_it_stands(
    number: int, recorded: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(recorded)
    snippet = fenced(API, "python")[number]
    exec(compile(snippet, "python-api.md", "exec"), {"__name__": "snippet"})  # noqa: S102
    assert bool(capsys.readouterr().out) == ("print" in snippet)


def test_the_page_names_all_that_the_package_gives() -> None:
    named = set(re.findall(r"`(\w+)", API))
    assert set(positioner.__all__) <= named
    assert len(fenced(API, "python")) > 5


def test_a_log_becomes_arrays_and_is_diagnosed(recorded: Path) -> None:
    log = load_log(recorded / "bus.log", complete=False)
    assert log.position_m.shape == log.setpoint_m.shape == log.current_ma.shape == log.mode.shape == (2400,)
    assert log.time_s[-1] == pytest.approx(2.399)
    assert 0.0099 < log.position_m.min() < 0.0101  # where the stem starts
    assert 0.085 < log.position_m.max() < 0.095
    assert {round(each, 3) for each in log.setpoint_m.tolist()} == {0.062, 0.09}
    assert (log.mode[0], log.mode[-1], log.rejected) == (-1, 2, 0)
    assert log.frames > 3 * 2400
    assert diagnose(recorded / "bus.log", recorded / "valve.toml").verdict is Verdict.YES
    with pytest.raises(PositionerError, match=r"valve.toml.*holds|valve.toml: "):
        load_log(recorded / "valve.toml")


def test_rows_before_the_first_setpoint_and_command_are_told_left_out_or_kept(recorded: Path) -> None:
    path = recorded / "bus.log"
    with pytest.warns(UserWarning, match=r"bus\.log: 1 of 2400 rows, .* NaN; complete=True leaves them out"):
        told = load_log(path)
    kept, complete = load_log(path, complete=False), load_log(path, complete=True)
    assert np.isnan([told.current_ma.max(), kept.current_ma.max()]).all()
    assert len(told.time_s) == len(kept.time_s) == 2400
    for name in ("time_s", "position_m", "setpoint_m", "current_ma", "mode"):
        assert getattr(complete, name).tolist() == getattr(kept, name)[1:].tolist()
    assert complete.current_ma.max() == np.nanmax(kept.current_ma)
    assert kept.mode[0] == -1
    silent = recorded / "silent.log"
    lines = path.read_text(encoding="ascii").splitlines(keepends=True)
    silent.write_text("".join(line for line in lines if " 100#" not in line), encoding="ascii")
    with pytest.raises(PositionerError, match="no stem position after both a setpoint and a command"):
        load_log(silent, complete=True)


def test_the_example_of_a_log_of_ones_own_prints_what_it_finds(recorded: Path) -> None:
    command = [sys.executable, str(ROOT / "examples" / "own_log.py"), "bus.log", "valve.toml"]
    done = subprocess.run(command, cwd=recorded, check=True, capture_output=True, text=True, timeout=120.0)
    assert "2399 readings until 2.4 s" in done.stdout
    assert "sticks: " in done.stdout


def test_the_page_on_laws_shows_the_example_to_the_letter() -> None:
    (law,) = fenced(OWN_LAW, "python")
    assert law == (ROOT / "examples" / "my_law.py").read_text(encoding="utf-8")
    assert [each.key for each in search_of(f"{ROOT}/examples/my_law.py:MyLaw").ranges] == ["parameters.gain_ma_per_m_s"]


def test_the_settings_on_the_page_are_settings() -> None:
    control, shadow, entry_points = fenced(OWN_LAW, "toml")
    valve = '[valve]\nid = "FV-101"\npreset = "paper"\n'
    found = parse_config(valve + control, "valve.toml", ROOT / "examples").control
    assert found.law == f"{ROOT}/examples/my_law.py:MyLaw"
    assert found.parameters == {"gain_ma_per_m_s": 1200.0}
    found = parse_config(valve + shadow, "valve.toml", ROOT / "examples").control
    assert (found.law, found.shadow) == ("nmpc", f"{ROOT}/examples/my_law.py:MyLaw")
    assert set(tomllib.loads(entry_points)["project"]["entry-points"]) == {"positioner.laws", "positioner.plants"}


def test_the_commands_of_the_page_parse() -> None:
    ours = ("positioner", "plant-emulator")
    for page, least in ((OWN_LAW, 6), (OWN_PLANT, 6)):
        lines = [line for block in fenced(page, "sh") for line in block.splitlines() if line.startswith(ours)]
        assert len(lines) >= least
        for line in lines:
            program, *words = shlex.split(line)
            parser = {"positioner": build_parser, "plant-emulator": plant_parser}[program]()
            parser.parse_args(words)


def test_the_plant_on_the_page_is_the_example_and_its_file_a_plant_file(tmp_path: Path) -> None:
    plant, wrapper = fenced(OWN_PLANT, "python")
    assert wrapper == (ROOT / "examples" / "fmu_plant.py").read_text(encoding="utf-8")
    assert plant == (ROOT / "examples" / "my_plant.py").read_text(encoding="utf-8")
    (tmp_path / "my_plant.py").write_text(plant, encoding="utf-8")
    (tmp_path / "my_valve.toml").write_text(fenced(OWN_PLANT, "toml")[0], encoding="utf-8")
    settings = plant_named(str(tmp_path / "my_valve.toml"))
    assert settings.physics == f"{tmp_path}/my_plant.py:LuGre"
    assert settings.valve.static_friction_n == 1500.0
    assert set(re.findall(r"^- \*\*`(\w+)", OWN_PLANT, flags=re.MULTILINE)) == {
        each for each in vars(OwnPhysics) if not each.startswith("_")
    }


def test_the_setpoints_and_the_noises_of_the_page_are_understood() -> None:
    from plant_emulator.presets import plant_settings  # noqa: PLC0415

    rows = re.findall(r"^\| `([^`]*)` \|", OWN_LAW.partition("## Setpoints")[2], flags=re.MULTILINE)
    setpoints, noise = rows[:6], rows[6:]
    assert len(noise) == 4
    for each in setpoints:
        if not each.endswith(".csv"):
            assert setpoints_in(each, plant_settings("paper"), 0.01).mm
    for each in noise:
        assert sensor_table(each)
