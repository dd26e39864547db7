"""examples/fmu_plant.py: an FMU, built as docs/own-plant.md says, is a plant. `make test-fmu`: FMPy is an extra."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from plant_emulator import valve
from plant_emulator.cli.main import main
from plant_emulator.plants import plant_named
from plant_emulator.presets import plant_settings
from positioner import simulate
from positioner.errors import ExitCode

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "own-plant.md").read_text(encoding="utf-8")
LAG = {"fill_time_constant_s": 0.03, "vent_time_constant_s": 0.03}
STEPS_MA = [8.0] * 40 + [14.0] * 300 + [13.0] * 60 + [6.0] * 300 + [20.0] * 400 + [4.0] * 400


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the examples with the FMU, built by the commands of the page."""
    folder = tmp_path_factory.mktemp("fmu")
    shutil.copytree(ROOT / "examples" / "fmu", folder / "examples" / "fmu")
    shutil.copy(ROOT / "examples" / "fmu_plant.py", folder / "examples")
    commands = PAGE.partition("```sh\ncd examples/fmu\n")[2].partition("positioner bench")[0]
    script = f"set -e\ncd examples/fmu\n{commands}"
    subprocess.run(["sh", "-c", script], cwd=folder, check=True, timeout=60.0)
    return folder / "examples"


def test_the_fmu_moves_as_the_emulators_own_valve_with_these_parameters(folder: Path) -> None:
    mine = plant_named(f"{folder}/fmu_plant.py:valve")
    theirs = plant_settings("noise-free", {"actuator": LAG, "valve": {"initial_position_m": 0.05}})
    assert (mine.valve, mine.actuator) == (theirs.valve, theirs.actuator)
    paths = []
    for settings in (mine, theirs):
        state, path = valve.initial_state(settings, 1), []
        for current_ma in STEPS_MA:
            state = valve.step(settings, state, current_ma, 1e-3)
            path.append((state.stem.position_m, state.stem.velocity_m_per_s))
        paths.append(np.array(path))
    error_m, error_m_per_s = np.abs(paths[0] - paths[1]).max(axis=0)
    assert np.ptp(paths[1][:, 0]) > 0.04
    assert 0.0 < error_m < 1e-4
    assert error_m_per_s < 0.025


def test_a_law_controls_it_twice_alike_and_two_of_them_beside_each_other(folder: Path) -> None:
    name = f"{folder}/fmu_plant.py:valve"
    first, second = (simulate(name, "pi", (73.0, 80.0), dwell_s=0.5) for _ in range(2))
    assert np.array_equal(first.position_m, second.position_m)
    assert np.ptp(first.position_m) > 0.02
    settings = plant_named(name)
    one, other = valve.initial_state(settings, 1), valve.initial_state(settings, 1)
    for _ in range(200):
        one, other = valve.step(settings, one, 20.0, 1e-3), valve.step(settings, other, 7.874, 1e-3)
    assert (one.stem.position_m > 0.09, other.stem.position_m) == (True, 0.05)


def test_an_fmu_that_is_missing_or_damaged_is_one_line(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(folder / "fmu_plant.py", tmp_path)
    for content, expected in ((None, "FileNotFoundError"), (b"PK\x03\x04 no zip", "BadZipFile")):
        if content is not None:
            (tmp_path / "valve.fmu").write_bytes(content)
        assert main(["simulate", "--plant", f"{tmp_path}/fmu_plant.py:valve"]) == ExitCode.CONFIG
        (line,) = capsys.readouterr().err.splitlines()
        assert f"{tmp_path}/fmu_plant.py:valve: " in line
        assert f"plant: cannot be made: {expected}" in line
