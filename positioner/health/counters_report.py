"""The counters as a person and a program read them. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.health.classes import DEVIATION_EDGES_PERCENT, SPAN_EDGES_PERCENT, TRAVEL_EDGES_PERCENT, short
from positioner.health.stress import stress
from positioner.wire.messages import Mode

if TYPE_CHECKING:
    from positioner.health.counters import Counters, CounterSettings

_US, _US_PER_H = 1e-6, 3.6e9
_BAR = 30


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


def count_rows(settings: CounterSettings, counters: Counters) -> list[tuple[str, str, str, str]]:
    """Return each counter as name, number, unit and what belongs to it."""
    cycle_band, travel_band = (
        100.0 * settings.dead_band_m(of_span, settings.travel_min_m + 0.5 * settings.span_m) / settings.span_m
        for of_span in (settings.cycle_band_of_span, settings.travel_band_of_span)
    )
    times_us = {**{mode.name: counters.mode_us[mode] for mode in Mode}, "FUNCTION_CHECK": counters.checked_us}
    percent = 100.0 * counters.travel_m / settings.span_m
    share = 100.0 * counters.stuck_us / counters.controlled_us if counters.controlled_us else None
    stuck = "not under control yet" if share is None else f"stuck for {share:.1f} % of the time under control"
    starts = "start" if counters.starts == 1 else "starts"
    rows = [
        ("hours of operation", _hours(counters.total_us), "h", f"in {counters.starts} {starts}"),
        *((f"time in {name}", _hours(time_us), "h", "") for name, time_us in times_us.items() if time_us),
        ("cycles", f"{counters.cycles}", "", f"reversals beyond {cycle_band:.2g} % of the span"),
        ("changes of direction", f"{counters.reversals}", "", f"beyond {travel_band:.2g} %"),
        ("travel", f"{counters.travel_m:.3f}", "m", f"{percent:.0f} % of the span"),
        ("full strokes", f"{counters.full_strokes(settings.span_m):.2f}", "", ""),
        ("slips", f"{counters.slips}", "", ""),
        ("sticks", f"{counters.sticks}", "", stuck),
        ("moves", f"{counters.moves}", "", ""),
        ("failed pushes", f"{counters.failed_pushes}", "", ""),
        ("closed", _hours(counters.closed_us), "h", ""),
        ("nearly closed", _hours(counters.near_closed_us), "h", ""),
        ("open", _hours(counters.open_us), "h", ""),
    ]
    if settings.wear:
        rows.append(("packing, life spent", f"{100.0 * stress(settings.wear, counters.spans):.3g}", "%", ""))
    return rows


def histograms(counters: Counters) -> tuple[tuple[tuple[str, ...], list[tuple[str, ...]]], ...]:
    """Return heads and rows of each histogram: class, samples, those of the last 100, and a bar."""
    sampled = ("seconds", "of the last 100", "")
    position = _classes(TRAVEL_EDGES_PERCENT, counters.travel, _travel_short(counters))
    deviation = _classes(DEVIATION_EDGES_PERCENT, counters.deviation, _deviation_short(counters))
    return (
        (("position, % of travel", *sampled), position),
        (("setpoint - position, % of the span", *sampled), deviation),
        (("span between reversals, % of the span", "cycles", ""), _classes(SPAN_EDGES_PERCENT, counters.spans)),
    )


def _hours(time_us: int) -> str:
    return f"{time_us / _US_PER_H:.2f}"


def _travel_short(counters: Counters) -> tuple[int, ...]:
    return short(counters.travel_recent, TRAVEL_EDGES_PERCENT)


def _deviation_short(counters: Counters) -> tuple[int, ...]:
    return short(counters.deviation_recent, DEVIATION_EDGES_PERCENT)


def _histogram(edges: tuple[float, ...], histogram: tuple[int, ...]) -> dict[str, Any]:
    """Return the edges in percent and the counts, one more: below the first edge, between each two, above the last."""
    return {"edges_percent": list(edges), "counts": list(histogram)}


def _classes(
    edges: tuple[float, ...], histogram: tuple[int, ...], recent: tuple[int, ...] = ()
) -> list[tuple[str, ...]]:
    """Return a row for each class from the first that holds something to the last; `recent` is a second column."""
    most, held = max(histogram), [at for at, count in enumerate(histogram) if count]
    rows = []
    for at in range(held[0], held[-1] + 1) if held else ():
        name = f"< {edges[0]:g}" if at == 0 else f"≥ {edges[-1]:g}" if at == len(edges) else _between(edges, at)
        beside = (f"{recent[at]}",) if recent else ()
        rows.append((name, f"{histogram[at]}", *beside, "#" * round(_BAR * histogram[at] / most)))
    return rows


def _between(edges: tuple[float, ...], at: int) -> str:
    return f"{edges[at - 1]:g} to {edges[at]:g}"
