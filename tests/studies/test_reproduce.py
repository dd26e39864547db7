"""`positioner reproduce`: what short runs show, how published results are assessed, and the files of the report."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.image import imread
from picture_checks import check

from plant_emulator.presets import plant_settings
from positioner.bench.metrics import Trace
from positioner.bench.playable import restartable_mm
from positioner.bench.scenario import MOST_SAMPLES_PER_SETPOINT, load_scenario
from positioner.cli.main import main
from positioner.studies import reproduce as reproduction
from positioner.studies.interpretations import Interpretation, NoiseKind, Units, interpretations
from positioner.studies.pool import Workers
from positioner.studies.published_results import Assessment, assess, summary
from positioner.studies.reproduce import (
    SIMULATIONS,
    Curves,
    Half,
    PlayedRun,
    Run,
    all_runs,
    half_figures,
    play,
    reproduce,
)
from positioner.studies.reproduce_pictures import FIGURE_OF, TITLES, page_figure, simulation_figure
from positioner.studies.reproduce_report import to_json, to_markdown
from positioner.valve.parameters import ValveParameters

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

A, FREE = Interpretation(NoiseKind.FILTERED, Units.SI), Interpretation(NoiseKind.FREE, Units.SI)
FREE_CM = Interpretation(NoiseKind.FREE, Units.CENTIMETRES)
ALL = interpretations((NoiseKind.FILTERED, NoiseKind.RAW))
CALM = Half(
    dwells=3,
    error_pct=0.6,
    range_pct=0.1,
    overshoot_pct=0.2,
    reversals=3,
    limit_cycles=0,
    current_range_ma=0.3,
    speed_m_per_s=0.0002,
)
LIVELY = Half(
    dwells=3,
    error_pct=1.6,
    range_pct=2.0,
    overshoot_pct=2.4,
    reversals=90,
    limit_cycles=3,
    current_range_ma=9.0,
    speed_m_per_s=0.2,
)


@pytest.fixture(scope="module")
def free() -> dict[int, PlayedRun]:
    """Simulations 1 to 3 without noise, short, in SI."""
    return {simulation: play(Run(simulation, FREE, short=True)) for simulation in (1, 2, 3)}


def test_simulation_1_overshoots_and_keeps_the_offset_that_the_weight_on_the_current_explains(
    free: dict[int, PlayedRun],
) -> None:
    # the text: an overshoot; e = u_eq / (147 mA/cm) without friction, in the mean of 70, 90 and 80 mm
    played, valve = free[1], ValveParameters(id="paper")
    offsets_m = [valve.balance_current_ma(setpoint_m) / 147.0 / 100.0 for setpoint_m in (0.07, 0.09, 0.08)]
    assert played.after.error_pct == pytest.approx(100.0 * float(np.mean(offsets_m)) / 0.127, rel=0.05)
    assert 1.5 < played.after.overshoot_pct < 2.9
    assert played.after.reversals > 3


def test_simulation_3_is_simulation_2_until_the_table_is_used_and_another_one_then(free: dict[int, PlayedRun]) -> None:
    assert free[3].before == free[2].before
    assert free[3].after != free[2].after
    bounds = free[3].curves.speed_high_m_per_s
    before = free[3].curves.time_s < 0.045 - 1e-9
    assert np.isnan(bounds[before]).all()
    assert np.isfinite(bounds[~before]).any()
    assert np.isnan(free[2].curves.speed_high_m_per_s).all()


def test_alpha_and_beta_in_centimetres_stop_the_valve_short_of_its_setpoint(free: dict[int, PlayedRun]) -> None:
    # 5 cm/s for 20 mm takes 400 ms; in SI the same bound is a braking curve
    played = play(Run(3, FREE_CM, short=True))
    assert played.before == free[3].before
    assert 3.0 < played.after.error_pct < 8.0
    assert 0.3 < free[3].after.error_pct < 2.0
    assert np.nanmax(played.curves.speed_high_m_per_s) < np.nanmax(free[3].curves.speed_high_m_per_s)


def test_a_pool_of_processes_returns_the_same_as_this_process(free: dict[int, PlayedRun]) -> None:
    (played,) = reproduce((Run(2, FREE, short=True),), Workers(1))
    assert (played.before, played.after) == (free[2].before, free[2].after)
    np.testing.assert_array_equal(played.curves.position_m, free[2].curves.position_m)


def test_the_figures_of_a_half_are_those_of_its_three_dwells() -> None:
    scenario = replace(load_scenario("paper-2"), sample_period_s=1e-3)
    time_s = np.arange(6000, dtype=np.float64) * np.float64(1e-3)
    setpoint_m = np.repeat([0.07, 0.09, 0.08, 0.07, 0.09, 0.08], 1000)
    # at rest 1 mm off before, in the second half a rectangle of 2 mm peak to peak, 20 ms long
    swing_m = np.where((time_s >= 3.0) & (time_s % 0.02 < 0.01 - 1e-9), 0.002, 0.0)
    position_m = setpoint_m - 0.001 + swing_m
    trace = Trace(time_s=time_s, position_m=position_m, setpoint_m=setpoint_m, current_ma=position_m * 100.0)
    speed_m_per_s = np.where(time_s % 1.0 < 0.5, 1.0, np.where(time_s % 0.02 < 0.01, 0.03, -0.03))
    before = half_figures(trace, speed_m_per_s, scenario, 0.127, range(3))
    assert before.error_pct == pytest.approx(100.0 / 127.0)
    assert (before.range_pct, before.current_range_ma) == pytest.approx((0.0, 0.0))
    assert before.speed_m_per_s == pytest.approx(0.03)
    assert (before.limit_cycles, before.reversals) == (0, 1)  # up by 20 mm, down by 10
    after = half_figures(trace, speed_m_per_s, scenario, 0.127, range(3, 6))
    assert after.range_pct == pytest.approx(200.0 / 127.0)
    assert after.current_range_ma == pytest.approx(0.2)
    assert after.limit_cycles == after.dwells == 3
    assert 295 <= after.reversals <= 300


def test_every_run_is_played_once_and_alpha_and_beta_only_where_a_table_is() -> None:
    runs = all_runs(ALL, short=False)
    assert len(runs) == len(set(runs)) == 2 * 3 + 3 * 6
    assert {run.interpretation.units for run in runs if run.simulation <= 2} == {Units.SI}


@pytest.mark.parametrize("simulation", SIMULATIONS)
def test_the_packaged_simulations_can_be_restarted_from_every_setpoint_and_played_on_a_bus(simulation: int) -> None:
    scenario = load_scenario(f"paper-{simulation}")
    assert (scenario.sample_period_s, scenario.duration_s, scenario.dwell_s) == (1e-4, 6.0, 1.0)
    assert scenario.samples_per_setpoint <= MOST_SAMPLES_PER_SETPOINT
    low_mm, high_mm = restartable_mm(plant_settings(overrides=scenario.plant))
    assert low_mm < min(scenario.setpoints_mm)
    assert max(scenario.setpoints_mm) < high_mm
    assert scenario.table_from_s == (None if simulation <= 2 else 3.0)
    short = Run(simulation, A, short=True).scenario
    assert short.duration_s == pytest.approx(0.09)
    assert short.table_from_s == (None if simulation <= 2 else pytest.approx(0.045))


def test_the_fifth_simulation_has_ten_percent_more_friction_and_not_the_misprint_of_the_text() -> None:
    # D2: not the 18784.7 N of the text
    valve = plant_settings(overrides=load_scenario("paper-5").plant).valve
    assert valve.static_friction_n == pytest.approx(1878.47)
    assert valve.coulomb_friction_n == pytest.approx(1565.3)


def played(run: Run, before: Half, after: Half) -> PlayedRun:
    time_s = np.linspace(0.0, 6.0, 61)
    flat = np.zeros(61)
    nothing = np.full(61, np.nan)
    curves = Curves(
        time_s=time_s,
        setpoint_m=flat + 0.08,
        position_m=flat + 0.079,
        current_ma=flat + 12.0,
        current_low_ma=nothing,
        current_high_ma=nothing,
        velocity_m_per_s=flat,
        speed_low_m_per_s=nothing,
        speed_high_m_per_s=np.where(time_s >= 3.0, 0.5, np.nan),
    )
    return PlayedRun(run, before, after, curves)


def as_the_paper_has_it(runs: Sequence[Run]) -> tuple[PlayedRun, ...]:
    """Return runs in which every published result holds."""
    found = []
    for run in runs:
        half = replace(LIVELY, range_pct={4: 3.0, 5: 1.0}.get(run.simulation, 2.0))
        before = {1: replace(CALM, overshoot_pct=2.4, error_pct=0.5)}.get(run.simulation, half)
        after = {1: replace(CALM, error_pct=0.5), 2: half}.get(run.simulation, CALM)
        found.append(played(run, before, after))
    return tuple(found)


def test_every_published_result_holds_where_everything_is_as_the_paper_has_it() -> None:
    found = assess(as_the_paper_has_it(all_runs(ALL, short=False)))
    assert len(found) == 4 * 3 + 11 * 6
    assert [assessment for assessment in found if not assessment.holds] == []


def test_a_short_run_decides_results_about_moves_and_no_others() -> None:
    played = as_the_paper_has_it(all_runs(ALL, short=True))
    found = assess(tuple(replace(each, before=CALM, after=CALM) for each in played))
    decided = {(assessment.simulation, assessment.result) for assessment in found if assessment.holds is not None}
    assert decided == {
        (1, "it overshoots in the transient"),
        (3, "it moves as in simulation 2 until the table is used"),
    }
    assert summary(found)[0] == f"{sum(bool(assessment.holds) for assessment in found)} of 9 results hold"
    text = to_markdown(played, found)
    assert "| 2 | stick-slip makes it oscillate continuously | not decided | as SI | not decided |" in text
    assert "| 1 | it overshoots in the transient | **no**: overshoot 0.20 % |" in text
    assert {assessment["holds"] for assessment in json.loads(to_json(played, found))["verdicts"]} == {True, False, None}


def test_where_nothing_is_decided_no_result_holds_and_none_fails() -> None:
    found = assess(as_the_paper_has_it(all_runs((A,), short=True)))
    assert summary(each for each in found if each.simulation == 2) == ("no result decided", None)
    assert summary(each for each in found if each.simulation == 1) == ("1 of 1 result holds", True)


@pytest.mark.parametrize(
    ("simulation", "before", "after", "failed"),
    [
        (1, {"error_pct": 1.1}, {}, "the stem reaches the reference"),
        (1, {"overshoot_pct": 0.4}, {}, "it overshoots in the transient"),
        (2, {}, {"limit_cycles": 2}, "stick-slip makes it oscillate continuously"),
        (2, {}, {"error_pct": 0.4}, "the error is worse than without friction"),
        (3, {"range_pct": 1.9}, {}, "it moves as in simulation 2 until the table is used"),
        (3, {}, {"limit_cycles": 1}, "the table ends the oscillation"),
        (3, {}, {"current_range_ma": 0.9}, "with the table the current is almost constant"),
        (3, {}, {"speed_m_per_s": 0.051}, "with the table the speed is almost constant"),
        (3, {}, {"error_pct": 1.1}, "the steady error is small, and not zero"),
        (3, {}, {"error_pct": 0.0}, "the steady error is small, and not zero"),
        (4, {"range_pct": 1.9}, {}, "at first it oscillates more than in simulation 3"),
        (4, {}, {"limit_cycles": 3}, "the table ends the oscillation"),
        (5, {"range_pct": 2.0}, {}, "at first it oscillates less than in simulation 3"),
        (4, {"limit_cycles": 0}, {}, "the table ends the oscillation"),
        (5, {}, {"error_pct": 5.0}, "the steady error is small, and not zero"),
    ],
)
def test_a_published_result_fails_with_the_figure_that_decides_it(
    simulation: int, before: dict[str, float], after: dict[str, float], failed: str
) -> None:
    played_runs = [
        replace(each, before=replace(each.before, **before), after=replace(each.after, **after))  # type: ignore[arg-type]
        if each.run.simulation == simulation
        else each
        for each in as_the_paper_has_it(all_runs((A,), short=False))
    ]
    lost = [assessment for assessment in assess(played_runs) if not assessment.holds]
    assert [(assessment.simulation, assessment.result) for assessment in lost] == [(simulation, failed)]


def test_a_stem_that_rests_is_neither_livelier_nor_quieter_than_another_one() -> None:
    rests = {3: replace(CALM, range_pct=0.05), 4: replace(CALM, range_pct=0.06), 5: replace(CALM, range_pct=0.04)}
    played_runs = [
        replace(each, before=rests.get(each.run.simulation, each.before))
        for each in as_the_paper_has_it(all_runs((A,), short=False))
    ]
    found = {assessment.result: assessment for assessment in assess(played_runs)}
    for result in (
        "at first it oscillates more than in simulation 3",
        "at first it oscillates less than in simulation 3",
        "the table ends the oscillation",
    ):
        assert not found[result].holds


def test_the_report_names_every_run_and_marks_what_does_not_hold() -> None:
    played_runs = as_the_paper_has_it(all_runs(ALL, short=False))
    run = Run(3, A)
    played_runs = tuple(replace(each, after=LIVELY) if each.run == run else each for each in played_runs)
    found = assess(played_runs)
    text = to_markdown(played_runs, found)
    assert "| 3 | the table ends the oscillation | **no**: in 3 of 3 dwells, range 2.00 → 2.00 % | yes:" in text
    assert text.count("**no**") == 4
    assert "| 2 | stick-slip makes it oscillate continuously | yes: in 6 of 6 dwells | as SI | yes:" in text
    assert "| 3: stiction table from half time | A, SI | 1.60 → 1.60 | 2.00 → 2.00 |" in text
    assert sum(text.count(f"| {simulation}: {TITLES[simulation]} |") for simulation in SIMULATIONS) == len(played_runs)
    assert "short run" not in text
    assert "A short run" in to_markdown(as_the_paper_has_it(all_runs(ALL, short=True)), found)


def test_the_json_has_the_same_figures_and_assessments() -> None:
    played_runs = as_the_paper_has_it(all_runs((A,), short=False))
    page = json.loads(to_json(played_runs, assess(played_runs)))
    assert [run["scenario"] for run in page["runs"]] == [f"paper-{simulation}" for simulation in SIMULATIONS]
    assert page["runs"][2]["after"]["error_pct"] == 0.6
    assert page["runs"][2]["setpoints_mm"] == [70.0, 90.0, 80.0, 70.0, 90.0, 80.0]
    assert len(page["verdicts"]) == 15
    assert all(assessment["holds"] is True for assessment in page["verdicts"])


@pytest.mark.slow(short="test_the_report_names_every_run_and_marks_what_does_not_hold")
def test_the_command_writes_the_page_the_figures_and_the_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[tuple[Sequence[Run], Workers]] = []

    def instead(runs: Sequence[Run], workers: Workers) -> tuple[PlayedRun, ...]:
        asked.append((runs, workers))
        return as_the_paper_has_it(runs)

    monkeypatch.setattr(reproduction, "reproduce", instead)
    out = tmp_path / "page"
    assert main(["reproduce", "--short", "--reading", "B", "--workers", "3", "--out", str(out), "--markdown"]) == 0
    ((runs, workers),) = asked
    assert workers == Workers(3)
    assert all(run.short for run in runs)
    assert {run.interpretation.noise for run in runs} == {NoiseKind.RAW, NoiseKind.FREE}
    pictures = {"reproduce.png", *(f"figure-{number}.png" for number in FIGURE_OF.values())}
    drawings = {name.replace(".png", ".svg") for name in pictures}
    assert {path.name for path in out.iterdir()} == pictures | drawings | {"reproduce.md", "reproduce.json"}
    assert imread(out / "reproduce.png").shape[0] <= 1080  # one screen
    assert sorted(FIGURE_OF.values()) == [4, 5, 6, 7, 8]
    for name in pictures:
        pixels = np.asarray(imread(out / name))
        assert min(pixels.shape[:2]) >= 600
        # ink, but mostly paper
        assert 0.005 < np.mean(pixels[..., :3].min(axis=2) < 0.8) < 0.3
    printed = capsys.readouterr().out
    assert printed.startswith((out / "reproduce.md").read_text(encoding="utf-8"))


def test_the_text_of_the_pictures_is_legible_and_covers_no_other_text() -> None:
    played = as_the_paper_has_it(all_runs(ALL, short=False))
    found = assess(played)
    check(page_figure(played, found))
    check(simulation_figure(3, played, found))


def test_an_assessment_names_its_interpretation() -> None:
    found = assess(as_the_paper_has_it(all_runs((A, FREE), short=False)))
    assert found[0] == Assessment(1, "the stem reaches the reference", A, "error 0.50, 0.50 %", holds=True)
    assert {assessment.interpretation for assessment in found} == {A, FREE}
