"""A plant with its own physics is a plant of every command that plays one; code that fails there is one line."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from positioner import simulate
from positioner.bench.inprocess import run_in_process
from positioner.bench.own_plant import with_own_physics, with_plant
from positioner.bench.scenario import Scenario, load_scenario
from positioner.bus.address import embedded_address
from positioner.campaign.reader import load_campaign
from positioner.campaign.run import Run, play
from positioner.cli.main import main
from positioner.errors import ConfigurationError, ExitCode
from positioner.studies.cluster import _code_of
from positioner.studies.code_digest import code_of_each
from positioner.studies.limit import optimal_move

ROOT = Path(__file__).resolve().parents[2]
LUGRE = f"{ROOT}/examples/my_plant.py:LuGre"
SPRING = """
import math
class Spring:
    '''A stem that follows its pressure with a lag of 30 ms, and rubs nowhere.'''
    tables = {'valve': {'static_friction_n': 200.0, 'coulomb_friction_n': 190.0, 'initial_position_m': 0.07}}
    def begin(self, seed):
        return 0.07, 0.0, 0.0
    def advance(self, state, current_ma, seconds):
        x, _, t = state
        BODY
        rest = min(max(333.637 * current_ma / 52538.0, 0.0), 0.1397)
        after = rest + (x - rest) * math.exp(-seconds / 0.03)
        return after, (rest - after) / 0.03, t + seconds
    def reading(self, state):
        return state[0]
    def truth(self, state):
        return state[:2]
"""
SCENARIO = Scenario(name="own", title="own physics", law="pi", setpoints_mm=(73.0, 80.0), dwell_s=0.5)


def written(folder: Path, body: str = "pass") -> str:
    (folder / "spring.py").write_text(SPRING.replace("BODY", body), encoding="utf-8")
    return f"{folder}/spring.py:Spring"


def test_simulate_plays_the_physics_and_tells_the_law_what_its_tables_say(tmp_path: Path) -> None:
    run = simulate(written(tmp_path), "pi", (73.0, 80.0), dwell_s=0.5)
    lagged = [0.07]
    for current_ma in run.current_ma[:-1]:
        rest_m = 333.637 * current_ma / 52538.0
        lagged.append(rest_m + (lagged[-1] - rest_m) * math.exp(-0.001 / 0.03))
    assert np.abs(run.position_m - lagged).max() < 1e-6  # the frames round
    assert np.abs(run.measured_m - run.position_m).max() < 4e-6
    assert run.totals.max_abs_error_pct < 1.0
    scenario = with_plant(SCENARIO, f"{tmp_path}/spring.py:Spring")
    assert (scenario.valve["static_friction_n"], scenario.valve["coulomb_friction_n"]) == (200.0, 190.0)


@pytest.mark.slow(short="test_simulate_plays_the_physics_and_tells_the_law_what_its_tables_say")
def test_the_example_is_controlled_within_half_a_percent() -> None:
    run = simulate(LUGRE, "nmpc", (73.0, 87.0, 80.0), dwell_s=0.6)
    assert run.totals.max_abs_error_pct < 0.5
    assert {round(each.setpoint_mm) for each in run.dwells} == {73, 87, 80}


@pytest.mark.bus
def test_a_bench_plays_it_on_a_bus_and_ends_with_one_line_where_it_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = tmp_path / "own.toml"
    scenario.write_text(
        'name = "own"\ntitle = "own"\nlaw = "pi"\nsetpoints_mm = [73.0, 80.0]\ndwell_s = 0.1\n'
        '[plant]\nphysics = "spring.py:Spring"\nvalve = { stick_velocity_m_per_s = 1e-3 }\n',
        encoding="utf-8",
    )
    name = written(tmp_path)
    words = ["bench", "--scenario", str(scenario), "--out", str(tmp_path / "out"), "--bus", str(embedded_address(93))]
    assert main(words) == ExitCode.OK
    capsys.readouterr()
    kept = np.array(json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))["dwells"][0]["travel_mm"])
    loaded = with_own_physics(load_scenario(str(scenario)))
    assert (loaded.valve["static_friction_n"], loaded.plant["valve"]["stick_velocity_m_per_s"]) == (200.0, 1e-3)
    run = run_in_process(loaded)
    truth_m = run.recording.true_position_m[:101]
    assert kept == pytest.approx(1e3 * np.abs(np.diff(truth_m)).sum(), rel=0.02)
    written(tmp_path, "1 / (t < 0.05)")
    assert main(words) == ExitCode.FAILURE
    errors = [line for line in capsys.readouterr().err.splitlines() if line.startswith("positioner: ")]
    (line,) = errors
    assert "plant-emulator ended with status 78" in line
    assert f"{name}: line 10: advance at 0.05" in line
    assert "ZeroDivisionError: division by zero" in line
    assert "Traceback" not in (tmp_path / "out" / "plant-emulator.log").read_text(encoding="utf-8")


def league(tmp_path: Path, plants: str) -> list[str]:
    words = ["league", "--plants", plants, "--laws", "pi", "--seeds", "1", "--setpoints", "75,80", "--dwell", "0.05"]
    return [*words, "--workers", "1", "--out", str(tmp_path / "out")]


def test_a_league_plays_it_loses_its_bouts_where_it_fails_and_plays_an_edited_one_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = written(tmp_path, "1 / (t < 0.02)")
    assert main(league(tmp_path, f"paper,{name}")) == ExitCode.FAILURE
    captured = capsys.readouterr()
    (line,) = [line for line in captured.err.splitlines() if line.startswith("positioner: ")]
    assert line.startswith(f"positioner: {name}: line 10: advance at 0.02")
    assert line.endswith(f"1 of its bouts, the first on {name}, seed 1, are not in the figures")
    assert "paper" in captured.out
    bouts = tmp_path / "out" / "bouts"
    before = {path: path.stat().st_mtime_ns for path in bouts.iterdir()}
    written(tmp_path)
    assert main(league(tmp_path, f"paper,{name}")) == ExitCode.OK
    assert "Spring" in capsys.readouterr().out
    again = [path.name for path in bouts.iterdir() if path.stat().st_mtime_ns != before.get(path)]
    assert len(again) == 1
    assert "Spring" in again[0]
    assert main(league(tmp_path, name.replace("Spring", "Sprung"))) == ExitCode.USAGE
    assert "spring.py has no Sprung; did you mean 'Spring'?" in capsys.readouterr().err


def test_an_installed_one_has_a_name(tmp_path: Path) -> None:
    written(tmp_path)
    package = tmp_path / "springs"
    package.mkdir()
    (tmp_path / "spring.py").rename(package / "__init__.py")
    info = tmp_path / "springs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: springs\nVersion: 1.0\n", encoding="utf-8")
    text = "[positioner.plants]\nmy-spring = springs:Spring\n"
    (info / "entry_points.txt").write_text(text, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(tmp_path), str(ROOT)))}
    for module, words in (
        ("positioner", league(tmp_path, "my-spring")),
        ("plant_emulator", ["simulate", "--plant", "my-spring", "--duration", "0.1"]),
    ):
        command = [sys.executable, "-m", f"{module}.cli.main", *words]
        done = subprocess.run(
            command, env=environment, cwd=tmp_path, check=False, capture_output=True, text=True, timeout=120.0
        )
        assert done.returncode == 0, done.stderr
        assert ("my-spring" if module == "positioner" else "0.07") in done.stdout


CAMPAIGN = """
name = "own"
title = "own physics"
laws = ["pi"]
seeds = [1]
[design]
kind = "grid"
[scenario]
setpoints_mm = [75.0]
dwell_s = 0.05
[scenario.plant]
physics = "spring.py:Spring"
[parameters]
"control.pi.integral_gain_ma_per_m_s" = { values = [500.0, 1000.0] }
"""


def test_a_campaign_plays_it_beside_its_file_with_the_tables_that_it_has(tmp_path: Path) -> None:
    name = written(tmp_path)
    path = tmp_path / "campaign.toml"
    path.write_text(CAMPAIGN, encoding="utf-8")
    campaign = load_campaign(path)
    assert campaign.base.plant["physics"] == name
    assert campaign.base.valve["static_friction_n"] == 200.0
    words = ["campaign", str(path), "--out", str(tmp_path / "out"), "--workers", "1"]
    assert main(words) == ExitCode.OK
    runs = tmp_path / "out" / "runs.jsonl"
    assert len(runs.read_text(encoding="utf-8").splitlines()) == 2
    assert main(words) == ExitCode.OK
    assert len(runs.read_text(encoding="utf-8").splitlines()) == 2  # kept
    written(tmp_path, "x += 0.0")
    assert main(words) == ExitCode.OK
    assert len(runs.read_text(encoding="utf-8").splitlines()) == 4  # other code
    written(tmp_path, "raise SystemExit(0)")
    (run, _) = campaign.runs()
    failure = play(run).failure or ""
    assert f"{name}: line 10: advance at 0 s: SystemExit: 0" in failure
    assert len(failure.splitlines()) == 1
    (tmp_path / "spring.py").unlink()
    with pytest.raises(ConfigurationError, match=r"scenario.plant.physics.*spring.py cannot be read"):
        load_campaign(path)


def test_the_digest_of_a_result_covers_the_file_of_its_physics_and_no_other(tmp_path: Path) -> None:
    name = written(tmp_path)
    own, other = Run(0, (), with_plant(SCENARIO, name)), Run(0, (), SCENARIO)

    def digests() -> tuple[str, ...]:
        return (*code_of_each((own, other), {"pi": "x"}), _code_of(own), _code_of(other))

    before = digests()
    assert before[1] == "x"
    (tmp_path / "beside.py").write_text("", encoding="utf-8")
    assert digests() == before
    written(tmp_path, "import beside")
    imported = digests()
    (tmp_path / "beside.py").write_text("X = 1\n", encoding="utf-8")
    changed = digests()
    assert len({before[0], imported[0], changed[0]}) == len({before[2], imported[2], changed[2]}) == 3
    assert before[1::2] == imported[1::2] == changed[1::2]


def test_the_time_optimal_move_is_that_of_a_valve_as_the_tables_say(tmp_path: Path) -> None:
    from plant_emulator.plants import plant_named  # noqa: PLC0415
    from plant_emulator.presets import plant_settings  # noqa: PLC0415

    own = plant_named(written(tmp_path, "1 / 0"))
    same = plant_settings("noise-free", {"valve": {"static_friction_n": 200.0, "coulomb_friction_n": 190.0}})
    assert optimal_move(own, 0.07, 0.08) == optimal_move(same, 0.07, 0.08)
