"""The page of `positioner diagnose --report`: the verdict on a loop, its signals, its evidence, every method. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from positioner.diagnostics.report import METHOD_HEAD, answer_row, headline
from positioner.diagnostics.shown import shown_part
from positioner.diagnostics.verdict import Verdict as Sticks
from positioner.report import words
from positioner.report.chart import Chart
from positioner.report.layers import Line, Marks
from positioner.report.page import Page, Section, Status, Verdict
from positioner.report.table import Table

if TYPE_CHECKING:
    from datetime import datetime

    from numpy.typing import NDArray

    from positioner.diagnostics.finding import Finding
    from positioner.diagnostics.loop_table import LoopTable
    from positioner.diagnostics.verdict import Estimate
    from positioner.report.layers import Layer

    Array = NDArray[np.float64]

_POINTS = 600
_JUDGED = {
    Sticks.YES: (Status.MAINTENANCE_REQUIRED, "Look at packing and actuator; measure them with positioner signature."),
    Sticks.NO: (Status.GOOD, "Nothing against stiction; other faults were not looked for."),
    Sticks.UNDECIDED: (Status.UNKNOWN, "Record a longer stretch, and the position of the stem with it."),
}


def diagnosis_page(finding: Finding, table: LoopTable, command: Array, made: datetime) -> Page:
    """Return the page; `command` is OP in percent."""
    status, action = _JUDGED[finding.verdict]
    verdict = Verdict(status, f"{headline(finding).capitalize()}: {finding.reason}.", action)
    sections = [_signals(finding, table, command)]
    if finding.indirect:
        methods = Table.of(METHOD_HEAD, map(answer_row, finding.indirect.answers))
        sections.append(Section("Methods on OP and PV", tables=(methods,)))
    period = (("sample period", f"{finding.period_s:g} s"),) if finding.is_timed else ()
    facts = (
        ("record", finding.source),
        *period,
        ("samples", f"{finding.samples}"),
        *((role, name) for role, name in table.names.items()),
    )
    name = finding.source.replace("\\", "/").rpartition("/")[2]
    return Page(name, f"Stiction, {words.date(made)}", tuple(sections), verdict, facts)


def _signals(finding: Finding, table: LoopTable, command: Array) -> Section:
    """Return trend and loop of the stretch that shows it best, S and J, and the notes."""
    begin, end = shown_part(finding, command.size)
    part = slice(begin, end, max((end - begin) // _POINTS, 1))
    times = np.arange(command.size, dtype=np.float64) * (table.period_s if table.is_timed else 1.0)
    unit = "s" if table.is_timed else "samples"
    answer, name = (table.stem, "Stem position") if table.stem is not None else (table.pv, "PV")
    charts = [_trend("Command", unit, "OP, %", times[part], command[part])]
    if answer is not None:
        charts.append(_trend(name, unit, name, times[part], answer[part]))
        layers: list[Layer] = [Line(_plain(command[part]), _plain(answer[part]))]
        if finding.direct and table.stem is not None:
            slips = [each for each in finding.direct.slips if begin <= each.before.begin < end]
            layers += [
                Marks([each.command_at_slip for each in slips], [each.before.place for each in slips], "slips", "up"),
                Marks([each.command_at_stop for each in slips], [each.after.place for each in slips], "stops", "down"),
            ]
        charts.append(Chart(f"{name} over OP", "OP, %", name, tuple(layers)))
    sizes = (("S, stick and dead band, of OP", finding.stick), ("J, slip jump, of OP", finding.jump))
    facts = tuple((title, _interval(size)) for title, size in sizes if size is not None)
    notes = (*finding.notes, *(finding.indirect.notes if finding.indirect else ()))
    since = f"samples {begin} to {end} of {command.size}"
    return Section("Signals", since, tuple(charts), remarks=tuple(f"{note}." for note in notes), facts=facts)


def _trend(title: str, unit: str, label: str, times: Array, values: Array) -> Chart:
    return Chart(title, f"time, {unit}", label, (Line(_plain(times), _plain(values)),))


def _plain(values: Array) -> list[float]:
    return [float(each) for each in values]


def _interval(size: Estimate) -> str:
    ends = words.interval(size.low, size.high, 2)
    return f"{words.number(size.value, 2)} % ({ends})"
