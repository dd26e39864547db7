"""The report of a bench: verdict, figures, pictures, settings, and the command that plays it again. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.bench.modes import ACTIVE_AT_LEAST, active_fraction, cause_in_words, mode_lines, name_of
from positioner.bench.result import blocks
from positioner.report.page import Page, Section, Status, Verdict
from positioner.report.table import Table

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from positioner.bench.modes import ModeSpan
    from positioner.bench.result import Result
    from positioner.report.picture import Picture

_MOST_SPANS = 30


def bench_page(result: Result, pictures: tuple[Picture, Picture], command: str) -> Page:
    """Return the page; `pictures` are the run and its moves, `command` is the one that plays it again."""
    scenario, run = result.scenario, result.run
    trend, moves = pictures
    tables = tuple(each for each in blocks(result) if isinstance(each, Table))
    facts = tuple(_facts(result))
    settings = (
        ("scenario", scenario.name),
        ("law", scenario.law),
        ("seed", str(scenario.seed)),
        ("period", f"{scenario.sample_period_s * 1e3:g} ms"),
        ("setpoints", f"{', '.join(f'{each:g}' for each in scenario.setpoints_mm)} mm, {scenario.visits} times"),
        ("dwell", f"{scenario.dwell_s:g} s"),
        *_flat("plant", scenario.plant),
        *_flat("valve", scenario.valve),
        *_flat("control", scenario.control),
        *_flat("estimator", scenario.estimator),
        *_flat("guard", scenario.guard),
    )
    sections = [
        Section("Figures", "by dwell; the last row sums them up", tables=tables, facts=facts),
        Section("The run", "spans in another mode than ACTIVE are shaded", pictures=(trend,)),
        Section("Single moves", "at least 60 % of each time axis is motion", pictures=(moves,)),
        Section("Settings", scenario.title, facts=settings, remarks=(f"To play it again: {command}",)),
    ]
    others = [span for span in result.modes if not span.is_normal]
    if others:
        sections.insert(1, _modes(others))
    made = (
        ("bus", run.bus),
        ("clock", run.clock),
        ("started", run.started_at),
        ("took", f"{run.wall_s:.1f} s"),
        ("machine", run.machine),
        *run.versions.items(),
    )
    return Page(f"{scenario.name}: {scenario.law}", "Bench", tuple(sections), _verdict(result), made, is_wide=True)


def _verdict(result: Result) -> Verdict:
    total = result.totals
    error = f"{total.mean_abs_error_pct:.2f} % mean error, {total.worst_mean_abs_error_pct:.2f} % in the worst dwell"
    active = active_fraction(result.modes)
    if active < ACTIVE_AT_LEAST:
        sentence = f"{mode_lines(result.modes)[0]}: the figures are not the law's."
        return Verdict(Status.FAILURE, sentence, "See the modes below: each has its cause.", "Not in control")
    unsettled, cycles = total.unsettled_1pct, total.limit_cycles
    if unsettled or cycles:
        sentence = f"{error}; {unsettled} of {total.dwells} dwells never settle to 1 %, {cycles} limit cycles."
        return Verdict(Status.OUT_OF_SPECIFICATION, sentence, "See the dwells below.", "Not every dwell is good")
    return Verdict(Status.GOOD, f"{error}; every dwell settles to 1 %, no limit cycle.", "", "Every dwell is good")


def _modes(spans: list[ModeSpan]) -> Section:
    rows = [
        (name_of(each.mode), cause_in_words(each.cause), f"{each.begin_s:.3f}", f"{1e3 * each.duration_s:.0f}")
        for each in spans[:_MOST_SPANS]
    ]
    left = (f"and {len(spans) - _MOST_SPANS} more: see result.json",) if len(spans) > _MOST_SPANS else ()
    table = Table.of(("mode", "cause", "from, s", "for, ms"), rows)
    return Section("Modes", "every span but ACTIVE without a cause", tables=(table,), remarks=left)


def _facts(result: Result) -> Iterator[tuple[str, str]]:
    total, before, after = result.totals, result.table_before, result.table_after
    yield "in control (ACTIVE)", f"{100.0 * active_fraction(result.modes):.2f} %"
    yield "settled to 1 %", f"{total.dwells - total.unsettled_1pct} of {total.dwells}"
    yield "settled to 2 %", f"{total.dwells - total.unsettled_2pct} of {total.dwells}"
    yield "limit cycles", str(total.limit_cycles)
    yield "travel", "–" if total.travel_ratio is None else f"{total.travel_ratio:.2f} times the shortest way"
    yield "stiction table", f"{before.recorded} to {after.recorded} samples, {after.cells} cells"


def _flat(name: str, table: Mapping[str, object]) -> Iterator[tuple[str, str]]:
    """Yield each setting of a table with its full name."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _flat(f"{name}.{key}", value)
        else:
            yield f"{name}.{key}", str(value)
