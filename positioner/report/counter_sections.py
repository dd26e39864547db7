"""The counters and histograms of a valve as sections. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.health.classes import SPAN_EDGES_PERCENT, TRAVEL_EDGES_PERCENT
from positioner.health.stress import stress
from positioner.report import words
from positioner.report.chart import Chart
from positioner.report.layers import Bars
from positioner.report.page import Section
from positioner.wire.messages import Mode

if TYPE_CHECKING:
    from positioner.health.counters import Counters

_HOUR_US = 3_600_000_000
_DEVIATION_NAMES = {-6: "\N{MINUS SIGN}5", -3: "\N{MINUS SIGN}0.5", 0: "0", 3: "0.5", 6: "5"}
"""By the distance of a class from the middle one, which lies about 0: the end that is nearer to 0, in percent."""


def counter_section(counters: Counters, span_m: float, since: str, wear: tuple[float, ...] = ()) -> Section:
    """Return the counts, and the time in each mode; `wear` is the life of the packing that each cycle takes."""
    total_us = max(counters.total_us, 1)

    def share(part_us: int, whole_us: int = total_us) -> str:
        return f"{100.0 * part_us / whole_us:.1f} %" if whole_us else words.NONE

    facts = [
        ("hours of operation", f"{counters.total_us / _HOUR_US:,.1f}"),
        ("starts", f"{counters.starts:,}"),
        ("cycles", f"{counters.cycles:,}"),
        ("reversals", f"{counters.reversals:,}"),
        ("travel, m", f"{counters.travel_m:,.2f}"),
        ("full strokes", f"{counters.full_strokes(span_m):,.1f}"),
        ("moves", f"{counters.moves:,}"),
        ("failed pushes", f"{counters.failed_pushes:,}"),
        ("slips", f"{counters.slips:,}"),
        ("sticks", f"{counters.sticks:,}"),
        ("stuck, of the time in control", share(counters.stuck_us, counters.controlled_us)),
        ("closed", share(counters.closed_us)),
        ("nearly closed", share(counters.near_closed_us)),
        ("open", share(counters.open_us)),
        *((("packing, life spent", f"{100.0 * stress(wear, counters.spans):.1f} %"),) if wear else ()),
    ]
    modes = [(mode.name, share(counters.mode_us[mode])) for mode in Mode if counters.mode_us[mode]]
    modes += [("FUNCTION_CHECK", share(counters.checked_us))] if counters.checked_us else []
    spaced = [(name, value.replace(",", "\N{NARROW NO-BREAK SPACE}")) for name, value in (*facts, *modes)]
    return Section("Counters", since, facts=tuple(spaced))


def histogram_section(counters: Counters, since: str) -> Section:
    """Return the histograms of travel, deviation and cycle spans, in percent of the samples."""
    travel_edges = (-5.0, *TRAVEL_EDGES_PERCENT, 105.0)
    span_edges = (0.0, *SPAN_EDGES_PERCENT, 105.0)
    classes = len(counters.deviation)
    names = tuple(_DEVIATION_NAMES.get(number - classes // 2, "") for number in range(classes))
    numbers = tuple(number - 0.5 for number in range(classes + 1))
    charts = (
        (_chart("Travel", "travel, % of span", travel_edges, counters.travel), counters.travel),
        (_chart("Deviation", "setpoint − position from … %", numbers, counters.deviation, names), counters.deviation),
        (_chart("Cycle spans", "span between reversals, %", span_edges, counters.spans), counters.spans),
    )
    remarks = tuple(f"{chart.title}: no sample yet." for chart, counts in charts if not any(counts))
    return Section("Histograms", since, tuple(chart for chart, counts in charts if any(counts)), remarks=remarks)


def _chart(
    title: str, x_label: str, edges: tuple[float, ...], counts: tuple[int, ...], names: tuple[str, ...] = ()
) -> Chart:
    whole = max(sum(counts), 1)
    heights = tuple(100.0 * each / whole for each in counts)
    return Chart(title, x_label, "% of the samples", (Bars(edges, heights),), from_zero=True, size="third", names=names)
