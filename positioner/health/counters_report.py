"""The counters as a person and a program read them. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.health.classes import DEVIATION_EDGES_PERCENT, SPAN_EDGES_PERCENT, TRAVEL_EDGES_PERCENT, short
from positioner.health.stress import stress
from positioner.wire.messages import Mode

if TYPE_CHECKING:
    from positioner.health.counters import Counters, CounterSettings

_US, _US_PER_H = 1e-6, 3.6e9
_BAR = 40


def as_values(settings: CounterSettings, counters: Counters) -> dict[str, Any]:
    """Return the counters with their units in the names, as `json.dumps` takes them."""
    return {
        "hours": counters.total_us / _US_PER_H,
        "starts": counters.starts,
        "observed_cycles": counters.observed,
        "time_in_mode_s": {mode.name: counters.mode_us[mode] * _US for mode in Mode},
        "function_check_s": counters.checked_us * _US,
        "cycles": counters.cycles,
        "reversals": counters.reversals,
        "travel_m": counters.travel_m,
        "travel_percent": 100.0 * counters.travel_m / settings.span_m,
        "full_strokes": counters.full_strokes(settings.span_m),
        "slips": counters.slips,
        "sticks": counters.sticks,
        "moves": counters.moves,
        "moves_from_table": counters.table_moves,
        "failed_pushes": counters.failed_pushes,
        "stuck_share": counters.stuck_us / counters.controlled_us if counters.controlled_us else None,
        "closed_s": counters.closed_us * _US,
        "near_closed_s": counters.near_closed_us * _US,
        "open_s": counters.open_us * _US,
        "histograms": {
            "travel": _histogram(TRAVEL_EDGES_PERCENT, counters.travel),
            "deviation": _histogram(DEVIATION_EDGES_PERCENT, counters.deviation),
            "cycle_spans": _histogram(SPAN_EDGES_PERCENT, counters.spans),
            "travel_last_100": _histogram(TRAVEL_EDGES_PERCENT, _travel_short(counters)),
            "deviation_last_100": _histogram(DEVIATION_EDGES_PERCENT, _deviation_short(counters)),
        },
        "stress_factor": stress(settings.wear, counters.spans) if settings.wear else None,
    }


def as_lines(settings: CounterSettings, counters: Counters) -> list[str]:
    """Return the counters as text, one line each, and the histograms as bars."""
    values = as_values(settings, counters)
    stuck = "unknown" if values["stuck_share"] is None else f"{100.0 * values['stuck_share']:.1f} %"
    cycle_band, travel_band = (
        100.0 * settings.dead_band_m(of_span, settings.travel_min_m + 0.5 * settings.span_m) / settings.span_m
        for of_span in (settings.cycle_band_of_span, settings.travel_band_of_span)
    )
    times_us = {**{mode.name: counters.mode_us[mode] for mode in Mode}, "FUNCTION_CHECK": counters.checked_us}
    modes = ", ".join(f"{name} {time_us / _US_PER_H:.2f} h" for name, time_us in times_us.items() if time_us)
    ends = (counters.closed_us, counters.near_closed_us, counters.open_us)
    closed_h, near_closed_h, open_h = (each / _US_PER_H for each in ends)
    rows = (
        ("hours of operation", f"{values['hours']:.2f}, in {counters.starts} starts"),
        ("time in each mode", modes or "none"),
        ("cycles", f"{counters.cycles} reversals beyond {cycle_band:.2g} % of the span"),
        ("changes of direction", f"{counters.reversals} beyond {travel_band:.2g} %"),
        (
            "travel",
            f"{counters.travel_m:.3f} m, {values['travel_percent']:.0f} %: {values['full_strokes']:.2f} strokes",
        ),
        ("slips, sticks", f"{counters.slips}, {counters.sticks}; stuck for {stuck} of the time under control"),
        ("moves", f"{counters.moves}, {counters.table_moves} of them from the table"),
        ("failed pushes", f"{counters.failed_pushes}"),
        ("closed, near it, open", f"{closed_h:.2f} h, {near_closed_h:.2f} h, {open_h:.2f} h"),
    )
    lines = [f"{name:<22} {text}" for name, text in rows]
    if settings.wear:
        lines.append(f"{'packing, life spent':<22} {100.0 * values['stress_factor']:.3g} %")
    last = "seconds, and of the last 100"
    position, error = f"position, % of travel: {last}", f"setpoint - position, % of the span: {last}"
    lines += ["", position, *_bars(TRAVEL_EDGES_PERCENT, counters.travel, _travel_short(counters))]
    lines += ["", error, *_bars(DEVIATION_EDGES_PERCENT, counters.deviation, _deviation_short(counters))]
    return [*lines, "", "span between reversals, % of the span: cycles", *_bars(SPAN_EDGES_PERCENT, counters.spans)]


def _travel_short(counters: Counters) -> tuple[int, ...]:
    return short(counters.travel_recent, TRAVEL_EDGES_PERCENT)


def _deviation_short(counters: Counters) -> tuple[int, ...]:
    return short(counters.deviation_recent, DEVIATION_EDGES_PERCENT)


def _histogram(edges: tuple[float, ...], histogram: tuple[int, ...]) -> dict[str, Any]:
    """Return the edges in percent and the counts, one more: below the first edge, between each two, above the last."""
    return {"edges_percent": list(edges), "counts": list(histogram)}


def _bars(edges: tuple[float, ...], histogram: tuple[int, ...], recent: tuple[int, ...] = ()) -> list[str]:
    """Return a line for each class from the first that holds something to the last; `recent` is a second column."""
    most = max(histogram)
    if most == 0:
        return ["  none yet"]
    held = [at for at, count in enumerate(histogram) if count]
    lines = []
    for at in range(held[0], held[-1] + 1):
        low = f"{edges[at - 1]:g}" if at else ""
        high = f"{edges[at]:g}" if at < len(edges) else ""
        beside = f"{recent[at]:>5}" if recent else ""
        bar = "#" * round(_BAR * histogram[at] / most)
        lines.append(f"  {low:>5} … {high:<5} {histogram[at]:>9}{beside}  {bar}".rstrip())
    return lines
