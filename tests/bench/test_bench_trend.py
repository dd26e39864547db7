"""The picture of a run: the peaks of long curves, the shades of the modes, the labels, and the file."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import imread
from picture_checks import check

from positioner.bench.metrics import Trace, dwell_metrics, totals
from positioner.bench.modes import ModeSpan
from positioner.bench.reasons import Reasons, reasons
from positioner.bench.scenario import parse_scenario
from positioner.bench.trend import TrendData, draw_trend, headline, title, trend_figure
from positioner.pictures.curves import envelope
from positioner.valve.stiction import Quantity
from positioner.wire.messages import Cause, Mode

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

SCENARIO = parse_scenario("name='s'\ntitle='a title'\nsetpoints_mm=[70, 80]\ndwell_s=1\nseed=7\n", "s.toml")


def example() -> TrendData:
    time_s = np.arange(2000, dtype=np.float64) * 1e-3
    setpoint_m = np.where(time_s < 1.0 - 1e-9, 0.07, 0.08)
    position_m = setpoint_m - 0.01 * np.exp(-(time_s % 1.0) / 0.05)
    current_ma = position_m * 157.5
    trace = Trace(time_s=time_s, position_m=position_m, setpoint_m=setpoint_m, current_ma=current_ma)
    dwells = dwell_metrics(trace, SCENARIO.dwell_edges_s, 0.127)
    velocity_m_per_s = np.gradient(position_m, time_s)
    return TrendData(
        scenario=SCENARIO,
        span_m=0.127,
        dwells=dwells,
        totals=totals(dwells),
        time_s=time_s,
        modes=(ModeSpan(Mode.ACTIVE, Cause.NONE, 0.0, 2.0),),
        position_m=position_m,
        measured_m=position_m + 1e-3 * np.random.default_rng(1).standard_normal(2000),
        setpoint_m=setpoint_m,
        current_ma=current_ma,
        current_lower_ma=np.full(2000, 11.0),
        current_upper_ma=np.where(time_s > 1.5, 12.5, np.nan),
        velocity_m_per_s=velocity_m_per_s,
        velocity_estimate_m_per_s=velocity_m_per_s + 0.02,
        velocity_lower_m_per_s=np.full(2000, -0.01),
        velocity_upper_m_per_s=np.full(2000, 0.1),
        learned_s={
            Quantity.STICK_SPEED: np.array([0.2, 1.2]),
            Quantity.BREAKAWAY_CURRENT: np.array([0.01, 1.01]),
            Quantity.LANDING_BIAS: np.array([1.3]),
        },
    )


def picture(path: Path, data: TrendData) -> NDArray[np.float32]:
    draw_trend(path, data)
    return np.asarray(imread(path))


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> NDArray[np.float32]:
    return picture(tmp_path_factory.mktemp("trend") / "trend.png", example())


def test_a_short_line_is_drawn_as_it_is() -> None:
    time_s = np.arange(10, dtype=np.float64)
    np.testing.assert_array_equal(envelope(time_s, time_s**2, 10)[1], time_s**2)


def test_a_long_line_keeps_every_peak_within_its_number_of_points() -> None:
    time_s = np.arange(100_003, dtype=np.float64) * 1e-4
    values = np.zeros(100_003)
    values[[17, 50_000, 100_002]] = (5.0, -7.0, 3.0)
    thin_s, thin = envelope(time_s, values, 1000)
    assert len(thin_s) == len(thin) == 1000
    assert sorted(thin[thin != 0.0]) == [-7.0, 3.0, 5.0]
    assert np.all(np.diff(thin_s) >= 0.0)
    assert thin_s[thin == -7.0] == pytest.approx(5.0, abs=0.02)


def test_an_envelope_keeps_a_single_value_among_none_and_none_where_there_is_none() -> None:
    values = np.full(50_000, np.nan)
    values[33_333] = 18.0
    _, thin = envelope(np.arange(50_000.0), values, 1000)
    assert np.nanmin(thin) == np.nanmax(thin) == 18.0
    assert np.isnan(thin).sum() == 998


def test_the_picture_has_1600_by_1200_pixels_and_the_same_ones_every_time(
    tmp_path: Path, plain: NDArray[np.float32]
) -> None:
    assert plain.shape == (1200, 1600, 4)
    np.testing.assert_array_equal(plain, picture(tmp_path / "again.png", example()))


PANELS = {"position": slice(140, 500), "current": slice(520, 730), "speed": slice(755, 965), "table": slice(990, 1130)}
"""Rows of the picture inside each panel."""


@pytest.mark.parametrize(
    ("field", "panel"),
    [
        ("measured_m", "position"),
        ("current_lower_ma", "current"),
        ("current_upper_ma", "current"),
        ("velocity_estimate_m_per_s", "speed"),
        ("velocity_lower_m_per_s", "speed"),
        ("velocity_upper_m_per_s", "speed"),
    ],
)
def test_a_quantity_is_drawn_in_its_panel_alone_and_left_out_where_there_is_none(
    tmp_path: Path, plain: NDArray[np.float32], field: str, panel: str
) -> None:
    without = picture(tmp_path / "b.png", replace(example(), **{field: None}))  # type: ignore[arg-type]
    changed = {name for name, rows in PANELS.items() if not np.array_equal(plain[rows], without[rows])}
    assert changed == {panel}


def interrupted(mode: Mode | None, begin_s: float, end_s: float) -> tuple[ModeSpan, ...]:
    return (
        ModeSpan(Mode.ACTIVE, Cause.NONE, 0.0, begin_s),
        ModeSpan(mode, Cause.FEEDBACK_STALE, begin_s, end_s),
        ModeSpan(Mode.ACTIVE, Cause.NONE, end_s, 2.0),
    )


@pytest.mark.parametrize("mode", [Mode.READY, Mode.HOLD, Mode.FAILSAFE, None])
def test_a_mode_other_than_active_shades_every_panel_while_it_lasts(
    tmp_path: Path, plain: NDArray[np.float32], mode: Mode | None
) -> None:
    data = example()
    other = picture(tmp_path / "b.png", replace(data, modes=interrupted(mode, 0.5, 0.9)))
    for rows in PANELS.values():
        columns = np.flatnonzero(np.any(plain[rows, :1380] != other[rows, :1380], axis=(0, 2)))  # not the names
        # the axes reach from 0.065 to 0.872 of 1600 pixels, and from 0 to 2 s
        in_s = (columns / 1600.0 - 0.065) / (0.872 - 0.065) * 2.0
        assert in_s.min() == pytest.approx(0.5, abs=0.01)
        assert in_s.max() == pytest.approx(0.9, abs=0.01)


def test_a_run_without_control_is_marked_above_its_figures_and_its_cause_stands_at_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[str] = []

    def noted(write: Any, place: int) -> Any:
        def do(*arguments: Any, **how: Any) -> Any:
            written.append(arguments[place])
            return write(*arguments, **how)

        return do

    monkeypatch.setattr(Axes, "annotate", noted(Axes.annotate, 1))
    monkeypatch.setattr(Figure, "text", noted(Figure.text, 3))
    picture(tmp_path / "a.png", example())
    assert not any("of the time" in line or "feedback stale" in line for line in written)
    picture(tmp_path / "b.png", replace(example(), modes=interrupted(Mode.FAILSAFE, 0.5, 0.9)))
    assert {"FAILSAFE: feedback stale", "FAILSAFE, 1 ×"} <= set(written)
    assert any(line.startswith("ACTIVE 80 % of the time  ·  error") for line in written)


def test_a_move_is_marked_and_a_fallback_too() -> None:
    time_s = np.array([0.1, 0.2, 0.3, 0.4])
    moves = [False, True, True, False]
    marks = reasons(time_s, moves, ["", "", "", "no plan: the fastest inputs that keep the bound"])
    assert (marks.moved_s.tolist(), marks.fell_back_s.tolist()) == ([0.2, 0.3], [0.4])


def test_the_marks_stand_in_the_panel_of_the_current(tmp_path: Path, plain: NDArray[np.float32]) -> None:
    why = Reasons(np.array([0.2, 0.4]), np.array([0.6]))
    marked = picture(tmp_path / "trend.png", replace(example(), why=why))
    rows = np.flatnonzero((marked != plain).any(axis=(1, 2))) / marked.shape[0]
    # the second of four panels, from its top: see draw_trend's ratios
    assert 0.40 < rows.min() < 0.47
    assert rows.max() < 0.65


def test_a_run_that_learned_nothing_is_drawn(tmp_path: Path, plain: NDArray[np.float32]) -> None:
    data = replace(example(), learned_s={quantity: np.array([]) for quantity in Quantity})
    empty = picture(tmp_path / "a.png", data)[PANELS["table"], 130:1380]
    filled = plain[PANELS["table"], 130:1380]
    assert np.mean(empty < 0.95) < 0.02 < np.mean(filled < 0.95)


def test_a_dwell_that_never_settles_has_a_label_of_another_colour(tmp_path: Path, plain: NDArray[np.float32]) -> None:
    data = example()
    bad = replace(data, dwells=(data.dwells[0], replace(data.dwells[1], settle_1pct_s=None)))
    other = picture(tmp_path / "b.png", bad)
    rows, columns = np.nonzero(np.any(plain != other, axis=2))
    assert 100 < rows.min() <= rows.max() < 140
    assert 750 < columns.min() <= columns.max() < 1395


def test_of_many_dwells_only_as_many_are_labelled_as_have_room(tmp_path: Path) -> None:
    data = example()
    short = replace(data.scenario, dwell_s=0.1, visits=10)  # 20 dwells, 12 labels at most: every second
    many = replace(data, scenario=short, dwells=data.dwells * 10)
    wrong = replace(data.dwells[0], mean_abs_error_pct=77.0)
    reference = picture(tmp_path / "a.png", many)
    for changed, visible in ((4, True), (5, False)):
        dwells = (*many.dwells[:changed], wrong, *many.dwells[changed + 1 :])
        other = picture(tmp_path / "b.png", replace(many, dwells=dwells))
        assert np.any(reference != other) == visible


def test_a_long_title_stays_inside_the_picture(tmp_path: Path) -> None:
    data = example()
    long = replace(data, scenario=replace(data.scenario, name="n" * 40, title="a title of many words " * 4))
    ink = np.flatnonzero(np.any(picture(tmp_path / "a.png", long)[30:60] < 0.9, axis=(0, 2)))
    assert 1500 < ink.max() < 1599


def test_the_title_names_scenario_law_seed_and_period() -> None:
    assert title(SCENARIO) == "s: a title  |  law paper, seed 7, period 1 ms"


def test_the_headline_names_the_figures_that_matter() -> None:
    total = replace(
        example().totals, mean_abs_error_pct=0.081, worst_mean_abs_error_pct=0.214, median_settle_1pct_s=0.0063,
        limit_cycles=0, travel_ratio=1.041,
    )  # fmt: skip
    assert headline(total) == (
        "error 0.08 % of span, worst dwell 0.21 %  ·  settling to 1 % 6.3 ms (median)"
        "  ·  limit cycles 0 of 2  ·  travel 1.04 times the shortest"
    )
    unsettled = replace(total, median_settle_1pct_s=None, unsettled_1pct=2, travel_ratio=None)
    assert "settling to 1 % never (median, 2 of 2 never)  ·  limit cycles 0 of 2" in headline(unsettled)
    assert "travel" not in headline(unsettled)


def test_the_text_of_the_picture_is_legible_and_covers_no_other_text() -> None:
    why = Reasons(np.array([0.2, 0.4]), np.array([0.6]))
    check(trend_figure(replace(example(), why=why, modes=interrupted(Mode.HOLD, 0.5, 0.503))))


def test_an_svg_stands_beside_the_picture(tmp_path: Path) -> None:
    draw_trend(tmp_path / "trend.png", example())
    svg = (tmp_path / "trend.svg").read_text("utf-8")
    assert f">{title(SCENARIO)}<" in svg
    assert len(svg) < 1_000_000
