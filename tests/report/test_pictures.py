"""Pictures inside a page, and the page of a bench: verdict first, all inside, and the command that repeats it."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import report_samples as samples
from matplotlib.figure import Figure
from picture_checks import check

from positioner.bench.metrics import Trace, dwell_metrics, totals
from positioner.bench.modes import ModeSpan
from positioner.bench.report_page import bench_page
from positioner.bench.result import Result, RunInfo, TableSummary
from positioner.bench.scenario import parse_scenario
from positioner.cli.chart_picture import figure_of
from positioner.cli.main import build_parser
from positioner.cli.run_report import command_again
from positioner.pictures.files import save
from positioner.report.chart import Chart
from positioner.report.layers import Line, Marks
from positioner.report.page import Page, Section, html
from positioner.report.picture import Picture
from positioner.report.procedure_page import charts_of
from positioner.wire.messages import Cause, Mode

if TYPE_CHECKING:
    from pathlib import Path

SCENARIO = parse_scenario(
    "name='s'\ntitle='a title'\nsetpoints_mm=[70, 80]\ndwell_s=1\nseed=7\nplant={preset='paper'}\n", "s.toml"
)
EMPTY = TableSummary(cells=0, recorded=0, stick_speeds=0, breakaway_currents=0, landing_biases=0)


def picture(folder: Path, name: str, *, dots: bool = False) -> Picture:
    figure = Figure(figsize=(4.0, 3.0))
    panel = figure.subplots()
    panel.plot([0.0, 1.0], [1.0, 0.0], marker="o")
    panel.plot([0.0, 1.0], [0.0, 1.0], ".", rasterized=dots)
    panel.set_title(f"picture & {name}")
    save(figure, folder / f"{name}.png")
    return Picture(f"The {name}", (folder / f"{name}.svg").read_text("utf-8"))


def result(modes: tuple[ModeSpan, ...] = (ModeSpan(Mode.ACTIVE, Cause.NONE, 0.0, 2.0),)) -> Result:
    time_s = np.arange(2000, dtype=np.float64) * 1e-3
    setpoint_m = np.where(time_s < 1.0 - 1e-9, 0.07, 0.08)
    trace = Trace(time_s=time_s, position_m=setpoint_m + 1e-5, setpoint_m=setpoint_m, current_ma=time_s + 10.0)
    dwells = dwell_metrics(trace, SCENARIO.dwell_edges_s, 0.127)
    return Result(
        scenario=SCENARIO,
        span_mm=127.0,
        modes=modes,
        totals=totals(dwells),
        dwells=dwells,
        table_before=EMPTY,
        table_after=EMPTY,
        run=RunInfo(
            bus="a bus", clock="lockstep", started_at="now", wall_s=1.0, machine="m", versions={"python": "3.11"}
        ),
    )


def test_a_picture_is_inside_the_page_without_what_would_reach_beyond_it(tmp_path: Path) -> None:
    both = (picture(tmp_path, "one"), picture(tmp_path, "other", dots=True))
    page = html(Page("t", "s", (Section("Pictures", pictures=both),), is_wide=True))
    assert page.count('<svg class="picture"') == 2
    assert "picture &amp; one" in page
    assert page.count("<style>") == 1
    assert not re.search(r"<metadata|<\?xml|DOCTYPE svg|figure_1", page)
    outside = {address for address in re.findall(r'https?://[^"\s<]+', page) if "www.w3.org" not in address}
    assert outside == set()
    names = re.findall(r' id="([^"]*)"', page)
    assert names
    assert all(f"#{name}" in page for name in names)


DOCUMENTS = {
    "signature": (samples.SIGNATURE, samples.signature(1.27)),
    "step-test": (samples.step_test(), samples.step_test(1.3)),
    "stroke-test": (samples.stroke_test(), samples.stroke_test(friction=1.2)),
}


@pytest.mark.parametrize("kind", DOCUMENTS)
@pytest.mark.parametrize("compared", [False, True], ids=["alone", "over a reference"])
def test_the_picture_of_a_procedure_has_the_figures_of_its_page_and_can_be_read(kind: str, compared: bool) -> None:
    before, now = DOCUMENTS[kind]
    charts = charts_of(kind, now, before if compared else None)
    figure = figure_of("FV-101: a title", charts)
    check(figure)
    assert len(figure.axes) == len(charts) > 1
    for panel, chart in zip(figure.axes, charts, strict=True):
        drawn = [(np.asarray(line.get_xdata()), np.asarray(line.get_ydata())) for line in panel.get_lines()]
        wanted = [(np.asarray(each.x), np.asarray(each.y)) for each in chart.layers if isinstance(each, Line | Marks)]
        np.testing.assert_equal(drawn, wanted)
        page = re.findall(r">([^<>]+)</text>", chart.svg())
        shown = [*panel.get_xticklabels(), *panel.get_yticklabels(), panel.xaxis.label]
        assert {text.get_text() for text in shown} | {chart.y_label} <= set(page)
        legend = panel.get_legend()
        names = [text.get_text() for text in legend.get_texts()] if legend else []
        assert names == [each.label for each in chart.layers if each.label]
        assert panel.get_xscale() == panel.get_yscale() == "linear"


def test_the_responses_are_shown_from_before_the_step_to_its_end_over_a_linear_time() -> None:
    first = charts_of("step-test", samples.step_test(), None)[0]
    x, y = first.scales()
    assert (x.low, x.high) == (-14.0, 56.0), "the axis ends with the curves"
    parts = [part for layer in first.layers for part in layer.ys()]
    assert y.low < min(parts), "no curve lies on the frame"
    assert max(parts) - min(parts) > 0.9 * (y.high - y.low), "no part of the panel is empty"
    assert {0.0, 1.0} <= set(y.ticks)
    asked = first.layers[0]
    assert isinstance(asked, Line)
    assert (asked.x, asked.y) == ([-14.0, 0.0, 0.0, 56.0], [0.0, 0.0, 1.0, 1.0])


def test_sizes_that_moved_nothing_take_no_room_and_one_that_did_is_seen_alone() -> None:
    document = samples.step_test()
    *_, times, gains = charts_of("step-test", document, None)
    assert times.names == gains.names == ("0.5 % B", "1 % C", "2 % C", "5 % C", "10 % C")
    document["sizes"] = document["sizes"][-2:]
    *_, times, _ = charts_of("step-test", document, None)
    assert [len(each.x) for each in times.layers if isinstance(each, Marks)] == [1, 1]


def test_a_reference_without_a_step_of_the_same_size_and_input_is_not_drawn() -> None:
    now, before = samples.step_test(), samples.step_test(1.3)

    def named() -> list[bool]:
        charts = charts_of("step-test", now, before)
        return [any(each.label == "reference" for each in chart.layers) for chart in charts]

    assert named() == [False, False, True, True]
    before["sizes"] = [each for each in before["sizes"] if each["size"] < 0.005]
    assert named() == [False] * 4
    before = {**samples.step_test(1.3), "input": "signal"}
    assert named() == [False] * 4


def test_a_legend_that_is_too_long_goes_on_in_a_second_row_above_the_axes() -> None:
    names = ("reference", "opening", "closing", "with a very long name", "and another one")
    chart = Chart("t", "x", "y", tuple(Line([0.0, 1.0], [0.0, 1.0], name) for name in names))
    text = chart.svg()
    assert text.count('<g transform="translate(0 14)">') == 2
    first = replace(chart, layers=chart.layers[:3]).svg()
    assert "translate" not in first
    levels = [[float(y) for y in re.findall(r'class="grid" d="M50 ([\d.]+)H', each)] for each in (text, first)]
    assert min(levels[0]) == pytest.approx(min(levels[1]) + 14.0)


def test_what_is_no_svg_is_no_picture() -> None:
    with pytest.raises(ValueError, match="is no SVG"):
        Picture("a", "<html></html>").svg()


def test_the_page_of_a_bench_begins_with_its_verdict_and_holds_everything(tmp_path: Path) -> None:
    both = (picture(tmp_path, "run"), picture(tmp_path, "moves"))
    page = html(bench_page(result(), both, "positioner bench --seed 7"))
    order = [page.index(words) for words in ("Every dwell is good", "Figures", "The run", "Single moves", "Settings")]
    assert order == sorted(order)
    for words in ("0.01 % mean error", "plant.preset", "3.11", "To play it again: positioner bench --seed 7", "seed"):
        assert words in page
    assert "What to do" not in page


def test_a_bench_without_control_says_so_and_lists_its_modes(tmp_path: Path) -> None:
    both = (picture(tmp_path, "run"), picture(tmp_path, "moves"))
    modes = (ModeSpan(Mode.ACTIVE, Cause.NONE, 0.0, 1.0), ModeSpan(Mode.FAILSAFE, Cause.FEEDBACK_STALE, 1.0, 2.0))
    page = html(bench_page(result(modes), both, "c"))
    assert "Not in control" in page
    assert "ACTIVE 50 % of the time: the figures are not the law" in page
    assert "feedback stale" in page


def test_a_bench_with_a_limit_cycle_is_out_of_specification(tmp_path: Path) -> None:
    both = (picture(tmp_path, "run"), picture(tmp_path, "moves"))
    found = replace(result(), totals=replace(result().totals, limit_cycles=1))
    assert "Not every dwell is good" in html(bench_page(found, both, "c"))


def test_the_command_that_plays_it_again_is_read_back_to_the_same_options() -> None:
    words = ["bench", "--scenario", "a file.toml", "--law", "pi", "--clock", "realtime"]
    parser = build_parser(words)
    first = parser.parse_args(words)
    again = command_again(first, "bench", ("scenario", "law", "plant", "seed", "clock"), seed=5)
    second = parser.parse_args(shlex.split(again)[1:])
    assert (second.scenario, second.law, second.clock, second.seed) == ("a file.toml", "pi", "realtime", 5)
    assert second.plant is None
