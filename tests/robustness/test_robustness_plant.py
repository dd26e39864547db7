"""The robustness test on one given plant: what is drawn around it, and what becomes of one that fails."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from plant_emulator.plants import plant_named
from plant_emulator.presets import plant_settings
from positioner.bench.configure import told
from positioner.campaign import study
from positioner.cli.main import main
from positioner.errors import ExitCode, UsageError
from positioner.robustness.cases import AS_CONFIGURED, BEYOND, CLASSES, NOT_CONFIGURED, WITHIN, WRONGLY, Case, drawn
from positioner.robustness.given_plant import base_of_plant
from positioner.robustness.play import Run, play
from positioner.robustness.space import packaged_space

SPACE = packaged_space()
LUGRE = f"{Path(__file__).resolve().parents[2]}/examples/my_plant.py:LuGre"
LAGGED = """
import math
class Lagged:
    tables = {
        'valve': {'static_friction_n': 200.0, 'coulomb_friction_n': 190.0, 'initial_position_m': 0.07},
        'actuator': {'fill_time_constant_s': 0.03, 'vent_time_constant_s': 0.03},
    }
    def begin(self, seed):
        return 0.07, 0.0
    def advance(self, state, current_ma, seconds):
        BODY
        rest = min(max(333.637 * current_ma / 52538.0, 0.0), 0.1397)
        after = rest + (state[0] - rest) * math.exp(-seconds / 0.03)
        return after, (rest - after) / 0.03
    def reading(self, state):
        return state[0]
    def truth(self, state):
        return state
"""


def written(folder: Path, body: str = "pass") -> str:
    (folder / "lagged.py").write_text(LAGGED.replace("BODY", body), encoding="utf-8")
    return f"{folder}/lagged.py:Lagged"


def cases_on(name: str, count: int = 16) -> dict[str, list[Case]]:
    base = base_of_plant(name)
    return {group: drawn(SPACE, group, count, 1, base) for group in CLASSES if group != BEYOND}


@pytest.mark.parametrize("name", [LUGRE, "real-valve", "graphite"])
def test_the_plant_is_the_same_in_every_case_but_for_the_noise_of_its_sensor(name: str) -> None:
    own = plant_named(name)
    for cases in cases_on(name).values():
        for case in cases:
            true = plant_settings(overrides=case.true)
            assert (true.valve, true.actuator, true.physics) == (own.valve, own.actuator, own.physics)
            assert (true.process, true.packing, true.stochastic) == (own.process, own.packing, own.stochastic)
            assert replace(true.sensor, noise_of_reading=0.0, noise_correlation_s=0.0, noise_hold_s=0.0,
                           resolution_m=0.0) == replace(own.sensor, noise_of_reading=0.0)  # fmt: skip
            assert case.force_step_n == 0.0


def test_what_the_positioner_is_told_period_noise_and_setpoints_are_drawn(tmp_path: Path) -> None:
    name = written(tmp_path)
    right, by_class = told(plant_named(name)), cases_on(name, 32)
    for case in by_class[AS_CONFIGURED]:
        assert told(plant_settings(overrides=case.told)) == right
        assert set(case.factors) == {"period_s", "noise_of_reading"}
    every = [case for cases in by_class.values() for case in cases]
    assert min(case.period_s for case in every) < 0.002
    assert max(case.period_s for case in every) > 0.01
    assert min(case.true["sensor"]["noise_of_reading"] for case in every) < 0.001
    assert max(case.true["sensor"]["noise_of_reading"] for case in every) > 0.005
    assert len({case.setpoints_mm for case in every}) == len(every)
    for case in by_class[WITHIN]:
        found = told(plant_settings(overrides=case.told))
        for key in ("spring_rate_n_per_m", "static_friction_n", "diaphragm_area_m2"):
            assert 0.8 <= found[key] / right[key] <= 1.2
        assert 0.8 <= found["actuator"]["fill_time_constant_s"] / 0.03 <= 1.2
    wrong = {name for case in by_class[WRONGLY] for name in case.factors} - {"period_s", "noise_of_reading"}
    assert "lag_s: configured over true" in wrong
    assert "dead_time_s configured and absent" in wrong
    assert "lag_s configured and absent" not in wrong  # it is there
    assert "true over configured friction" not in wrong
    absent = [case for case in by_class[NOT_CONFIGURED] if "lag_s, not configured" in case.factors]
    assert 4 < len(absent) < 28
    for case in absent:
        assert case.factors["lag_s, not configured"] == 0.03
        assert case.told["actuator"]["fill_time_constant_s"] == 0.0
    kinds = {name for case in by_class[NOT_CONFIGURED] for name in case.factors}
    assert kinds == {"period_s", "noise_of_reading", "lag_s, not configured", "correlated_noise_s, not configured",
                     "held_noise_s, not configured", "resolution_of_span, not configured"}  # fmt: skip
    for case in by_class[NOT_CONFIGURED]:
        sensor = case.true["sensor"]
        assert not (sensor["noise_correlation_s"] and sensor["noise_hold_s"])


def test_a_plant_that_changes_by_schedule_is_none_to_study(tmp_path: Path) -> None:
    file = tmp_path / "plant.toml"
    file.write_text('preset = "paper"\n[[schedule]]\nat_s = 1.0\nkey = "sensor.zero_m"\nvalue = 0.001\n', "utf-8")
    with pytest.raises(UsageError, match=r"plant.toml: \[\[schedule\]\] changes it"):
        base_of_plant(str(file))


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two setpoints a valve, played in this process."""
    space = replace(packaged_space(), dwells=2)
    monkeypatch.setattr("positioner.robustness.space.packaged_space", lambda: space)
    monkeypatch.setattr(study, "spread_out", lambda function, items, _: ((item, function(item)) for item in items))


@pytest.mark.usefixtures("small")
def test_a_study_on_a_plant_with_its_own_physics_shows_four_classes_and_plays_an_edited_one_anew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, out = written(tmp_path), tmp_path / "out"
    words = ["robustness", "--plant", name, "--laws", "pi", "--valves", "1", "--out", str(out)]
    assert main(words) == ExitCode.OK
    shown = capsys.readouterr().out
    assert f"Robustness: 4 cases on {name}, tuning seeds" in shown.replace("\n", " ")
    classes = json.loads((out / "report.json").read_text(encoding="utf-8"))["classes"]
    assert {each["class"] for each in classes} == {*CLASSES, "all"} - {BEYOND}
    journal = out / "runs" / "pi" / "runs.jsonl"
    played = len(journal.read_text(encoding="utf-8").splitlines())
    assert 4 <= played <= 8  # each case, and some told everything
    assert main(words) == ExitCode.OK
    assert len(journal.read_text(encoding="utf-8").splitlines()) == played
    written(tmp_path, "1 / 0")
    assert main(words) == ExitCode.FAILURE
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith("positioner: no case could be played: ConfigurationError: ")
    assert f"{name}: line 11: advance at 0 s: ZeroDivisionError: division by zero: mend it" in line


def test_a_plant_that_fails_is_a_failure_of_its_run_alone(tmp_path: Path) -> None:
    (case,) = drawn(replace(SPACE, dwells=1), AS_CONFIGURED, 1, 1, base_of_plant(written(tmp_path, "exit()")))
    assert "advance at 0 s: SystemExit: None" in (play(Run(case, "pi")).failure or "")


def test_a_plant_that_is_none_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path)
    assert main(["robustness", "--plant", f"{tmp_path}/lagged.py:Legged"]) == ExitCode.USAGE
    assert "lagged.py has no Legged; did you mean 'Lagged'?" in capsys.readouterr().err
