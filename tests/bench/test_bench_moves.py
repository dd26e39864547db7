"""The picture of single moves: windows that are mostly motion, the prediction of the law's model, and what is drawn."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.colors import to_hex
from picture_checks import check, texts_of

from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.metrics import dwell_metrics, totals
from positioner.bench.modes import ModeSpan
from positioner.bench.moves import MOTION_SHARE, MovesData, telling, windows
from positioner.bench.moves_picture import MOST_MOVES, draw_moves, moves_figure
from positioner.bench.result import Result, RunInfo, summary_of
from positioner.bench.scenario import parse_scenario
from positioner.bench.trace_data import picture_data
from positioner.cycle.events import Learned
from positioner.pictures.colours import BELIEF, COMMAND, MEASURED, POSITION, SETPOINT
from positioner.runtime.trace import TraceWriter
from positioner.valve.stiction import Direction, Quantity, StictionTable
from positioner.wire.messages import Cause, Mode

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

QUICK = """
name = "quick"
title = "no lag, no noise"
law = "nmpc"
setpoints_mm = [73.0, 87.0, 80.0]
dwell_s = 0.15
plant = { preset = "noise-free" }
"""
OTHER = """
name = "other"
title = "friction 20 % above what the law knows"
law = "nmpc"
setpoints_mm = [73.0, 87.0, 80.0, 73.0, 87.0, 80.0]
dwell_s = 0.15
plant = { preset = "noise-free", valve = { static_friction_n = 2049.2, coulomb_friction_n = 1707.6 } }
"""
SLOW = """
name = "slow"
title = "a lag of 50 ms"
law = "nmpc"
setpoints_mm = [73.0, 87.0]
dwell_s = 0.5
plant = { preset = "real-valve" }
valve = { preset = "real-valve" }
"""


def data_of(text: str, folder: Path) -> MovesData:
    """Return the data of the picture of a run without a bus."""
    scenario = parse_scenario(text, "s.toml")
    configuration = configure(scenario)
    run = run_in_process(scenario)
    trace = TraceWriter(folder / "trace.csv")
    lessons = [event for event in run.events if isinstance(event, Learned)]
    for cycle in run.cycles:
        told = [event for event in lessons if event.sequence <= cycle.table_sequence]
        trace.cycle([*told, cycle])
        del lessons[: len(told)]
    trace.close()
    assert not lessons
    span_m = configuration.valve.span_m
    dwells = dwell_metrics(run.recording.trace, scenario.dwell_edges_s, span_m)
    result = Result(
        scenario=scenario,
        span_mm=span_m * 1e3,
        modes=(ModeSpan(Mode.ACTIVE, Cause.NONE, 0.0, scenario.duration_s),),
        totals=totals(dwells),
        dwells=dwells,
        table_before=summary_of(run.table),
        table_after=summary_of(run.table),
        run=RunInfo(bus="", clock="", started_at="", wall_s=0.0, machine="", versions={}),
    )
    empty = StictionTable(cell_width_m=configuration.control.table_cell_m)
    return picture_data(result, run.recording, folder / "trace.csv", configuration, empty)[1]


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> MovesData:
    return data_of(QUICK, tmp_path_factory.mktemp("quick"))


@pytest.fixture(scope="module")
def slow(tmp_path_factory: pytest.TempPathFactory) -> MovesData:
    return data_of(SLOW, tmp_path_factory.mktemp("slow"))


def slides(*edges: tuple[int, int]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return positions that grow by 1 mm in each sample of these spans, and rest elsewhere."""
    steps = np.zeros(200)
    for begin, end in edges:
        steps[begin:end] = 1e-3
    return np.concatenate(([0.0], np.cumsum(steps)))


def test_a_window_begins_and_ends_a_quarter_of_the_motion_around_it() -> None:
    (found,) = windows(slides((30, 70)), 0.1, 1e-3)
    assert (found.first, found.begin, found.end, found.last, found.moving) == (20, 30, 70, 80, 40)
    assert found.motion_share == pytest.approx(2.0 / 3.0)
    assert found.travel_m == pytest.approx(0.04)


def test_a_window_ends_with_the_run() -> None:
    (found,) = windows(slides((0, 40)), 0.1, 1e-3)
    assert (found.first, found.last) == (0, 50)
    (found,) = windows(slides((160, 200)), 0.1, 1e-3)
    assert found.last == 200
    assert windows(slides(), 0.1, 1e-3) == ()


def test_slides_that_follow_closely_are_one_move_and_others_are_not() -> None:
    assert [each.moving for each in windows(slides((30, 60), (61, 70)), 0.1, 1e-3)] == [39]
    assert [each.moving for each in windows(slides((30, 60), (80, 110)), 0.1, 1e-3)] == [30, 30]


def test_the_first_moves_that_tell_something_are_shown_in_their_order() -> None:
    found = windows(slides((10, 12), (20, 30), (50, 51), (80, 90), (120, 130)), 0.1, 1e-3)
    assert [each.begin for each in telling(found, 0.5, 2)] == [20, 80]
    assert [each.begin for each in telling(found, 0.5, 4)] == [10, 20, 80, 120]


@pytest.mark.parametrize("run", ["quick", "slow"])
def test_most_of_each_time_axis_is_motion(run: str, request: pytest.FixtureRequest) -> None:
    data: MovesData = request.getfixturevalue(run)
    trend, figure = data.trend, moves_figure(data)
    positions: list[Axes] = figure.axes[::3]
    assert len(positions) == len(data.shown) >= 2
    for panel, window in zip(positions, data.shown, strict=True):
        low_ms, high_ms = panel.get_xlim()
        moved = np.abs(np.diff(trend.position_m[window.first : window.last + 1])) > 2e-7
        assert high_ms - low_ms == pytest.approx(len(moved), abs=1e-6)
        assert MOTION_SHARE <= moved.sum() / (high_ms - low_ms) <= 1.0


def test_without_noise_the_prediction_is_the_motion(quick: MovesData) -> None:
    for window, path_m in zip(quick.shown, quick.predicted, strict=True):
        true_m = quick.trend.position_m[window.first : window.last + 1]
        off_m = np.abs(path_m - true_m)[window.begin - window.first :]
        most = 0.001 if abs(window.travel_m) > 0.01 else 0.2  # the third one is as short as a slip jump
        assert 0.0 < float(off_m[-1]) < most * abs(window.travel_m)
        assert float(off_m.max()) < 0.25 * abs(window.travel_m)  # of two slips in one window the second is a bit late


def test_a_prediction_knows_what_was_learned_before_its_move_and_nothing_of_later(tmp_path: Path) -> None:
    whole = data_of(OTHER, tmp_path)
    begin = data_of(OTHER.replace("73.0, 87.0, 80.0, 73.0, 87.0, 80.0", "73.0, 87.0, 80.0"), tmp_path)
    assert len(whole.shown) == 6
    assert begin.shown[:3] == whole.shown[:3]
    for early, late in zip(begin.predicted[:3], whole.predicted[:3], strict=True):
        np.testing.assert_array_equal(early, late)
    first, last = (
        float(abs(whole.predicted[number][-1] - whole.trend.position_m[window.last]))  # where the stem ends
        for number, window in enumerate(whole.shown)
        if number in {0, 5}
    )
    assert first > 2e-3
    assert 0.0 < last < 0.25 * first


def test_the_trace_holds_the_samples_of_the_table_to_the_bit(tmp_path: Path) -> None:
    data_of(OTHER, tmp_path)
    scenario = parse_scenario(OTHER, "s.toml")
    with (tmp_path / "trace.csv").open(encoding="utf-8", newline="") as file:
        learned = [json.loads(row["learned"]) for row in csv.DictReader(file) if row["learned"]]
    table = StictionTable(cell_width_m=configure(scenario).control.table_cell_m)
    for sample in (each for some in learned for each in some):
        quantity, direction = Quantity(sample["quantity"]), Direction(sample["direction"])
        table = table.record(quantity, sample["position_m"], direction, sample["value"])
    assert table == replace(run_in_process(scenario).table, fit=None)  # what is believed beside them is in no sample
    assert table.sequence > 5


def test_behind_a_lag_the_prediction_begins_where_the_law_begins_its_move(slow: MovesData) -> None:
    for window, path_m in zip(slow.shown, slow.predicted, strict=True):
        assert np.isfinite(path_m[-1])
        assert abs(path_m[-1] - slow.trend.position_m[window.end]) < 0.1 * abs(window.travel_m) + 1e-3


def test_each_panel_shows_its_quantities_in_their_colours(quick: MovesData) -> None:
    position, speed, current = moves_figure(quick).axes[:3]

    def colours(panel: Axes) -> set[str]:
        lines = {str(each.get_color()).upper() for each in panel.get_lines()}
        return lines | {
            to_hex(each).upper() for group in panel.collections for each in np.atleast_2d(group.get_edgecolor())
        }

    assert {POSITION, SETPOINT, MEASURED, BELIEF} <= colours(position)
    assert {POSITION, BELIEF} <= colours(speed)
    assert COMMAND in colours(current)


@pytest.mark.parametrize("run", ["quick", "slow"])
def test_the_text_is_legible_and_covers_no_other_text(run: str, request: pytest.FixtureRequest) -> None:
    check(moves_figure(request.getfixturevalue(run)))


def test_the_picture_says_how_many_moves_it_leaves_out_and_names_breakaway_currents(quick: MovesData) -> None:
    more = replace(quick, count=9, shown=quick.shown[:1])
    words = [text.get_text() for text, _ in texts_of(moves_figure(more))]
    assert "1 of 9 moves: the first ones of at least 0.64 mm; 8 left out" in words
    assert any(re.search(r"\nΓ \d+\.\d\d mA$", each) for each in words)
    assert any(f"every move of the run: {quick.count}" in text.get_text() for text, _ in texts_of(moves_figure(quick)))


def test_a_mode_that_interrupts_a_move_is_named_in_its_panel(quick: MovesData) -> None:
    begin_s = float(quick.trend.time_s[quick.shown[0].begin])
    modes = (*quick.trend.modes, ModeSpan(Mode.HOLD, Cause.FEEDBACK_STALE, begin_s + 0.002, begin_s + 0.004))
    words = [
        text.get_text() for text in moves_figure(replace(quick, trend=replace(quick.trend, modes=modes))).axes[0].texts
    ]
    assert words == ["HOLD: feedback stale"]


def test_a_run_without_a_move_says_so(tmp_path: Path, quick: MovesData) -> None:
    draw_moves(tmp_path / "moves.png", replace(quick, shown=(), count=0))
    assert ">the stem did not move<" in (tmp_path / "moves.svg").read_text("utf-8")
    assert len(quick.shown) <= MOST_MOVES
