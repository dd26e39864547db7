"""A signature in words: a row for each quantity, and what was not reached. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from positioner.commissioning.report import Row, bench_set
from positioner.health.reference import kept_travel_m

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.commissioning.loop_branches import Branch
    from positioner.commissioning.signature import Signature
    from positioner.valve.parameters import ValveParameters

_MM = 1e3
_LOOP_POINTS = 150
_NAMES = ("spring_n_per_m", "sliding_n", "static_n", "hysteresis_m")
"""The quantities in SI units, by which a later signature is compared with this one."""


def rows(found: Signature, valve: ValveParameters, pressure_unit: str) -> tuple[Row, ...]:
    """Return the quantities, with a 95 % interval where there is one."""
    of_span = 100.0 / valve.span_m
    friction = [each.friction_n for each in found.by_place]
    return (
        Row.of("spring rate", "N/m", found.spring_n_per_m),
        Row.of("spring force at 0", "N", found.preload_n),
        Row.of("sliding friction", "N", found.sliding_n),
        Row.exact("sliding friction, least", "N", min(friction)),
        Row.exact("sliding friction, largest", "N", max(friction)),
        Row.of("static friction", "N", found.static_n),
        Row.exact("hysteresis", "% of span", found.hysteresis_m * of_span),
        Row.exact("dynamic error band", "% of span", found.dynamic_error_band_m * of_span),
        *bench_set(found.spring_n_per_m, found.preload_n, valve, pressure_unit, found.reached_m),
        Row.exact("seat load", "N", found.seat_load_n),
    )


def remarks(found: Signature, valve: ValveParameters) -> tuple[str, ...]:
    """Return what a person should know besides the values, a line each."""
    low_m, high_m = found.reached_m
    lines = [
        f"strokes at {found.rate_ma_per_s:.3g} mA/s: the stem slid at {found.speed_m_per_s * _MM:.2f} mm/s",
        f"from {len(found.by_place)} places of the travel, and {len(found.breakaways)} breakaways",
    ]
    if found.slow_ma_per_s < found.rate_ma_per_s:
        lines.append(f"at {found.slow_ma_per_s:.3g} mA/s it stuck again and again; the error band is that of this rate")
    for name, begin_m, end_m in (("closed", valve.travel_min_m, low_m), ("open", high_m, valve.travel_max_m)):
        stop_m = found.closed_m if name == "closed" else found.open_m
        if not math.isnan(stop_m):
            lines.append(f"the stem met the {name} stop, at {stop_m * _MM:.2f} mm")
        elif end_m - begin_m > 0.0:
            lines.append(
                f"not reached: {begin_m * _MM:.1f} to {end_m * _MM:.1f} mm; bench set and stop there are extrapolated"
            )
    if math.isnan(found.seat_load_n):
        lines.append("seat load: not measured, the stem did not meet the closed stop")
    return tuple(lines)


def as_json(found: Signature, valve: ValveParameters, pressure_unit: str) -> dict[str, Any]:
    """Return the result for a program, and for a later comparison."""
    return {
        "valve": valve.id,
        "travel_m": kept_travel_m(valve),
        "quantities": {name: _number(found, name) for name in _NAMES},
        "rows": [row.as_json() for row in rows(found, valve, pressure_unit)],
        "sliding_friction_by_place": [[each.position_m, each.friction_n] for each in found.by_place],
        "breakaways": [[each.position_m, each.direction, each.static_n] for each in found.breakaways],
        "reached_m": list(found.reached_m),
        "remarks": list(remarks(found, valve)),
    }


def fitted_lines(found: Signature, valve: ValveParameters) -> dict[str, Any]:
    """Return the spring, and the spring with the sliding friction both ways, as lines over the travel that was seen."""
    gain, friction_n = valve.force_gain_n_per_ma, found.sliding_n.value
    spring_n = [found.spring_n_per_m.value * place_m + found.preload_n.value for place_m in found.reached_m]
    return {
        name: {
            "position_m": list(found.reached_m),
            "pressure_ma": [[(force_n + side * friction_n) / gain for force_n in spring_n] for side in sides],
        }
        for name, sides in (("spring", (0.0,)), ("friction", (1.0, -1.0)))
    }


def loop_points(loop: Sequence[Branch]) -> list[dict[str, Any]]:
    """Return the last two branches for a figure: pressure in mA and place in m, of some readings each."""
    return [
        {
            "direction": each.direction,
            "pressure_ma": [round(float(p), 4) for p in each.pressure_ma[:: _step(each)]],
            "position_m": [round(float(x), 6) for x in each.position_m[:: _step(each)]],
        }
        for each in loop[-2:]
    ]


def _step(branch: Branch) -> int:
    return max(len(branch.pressure_ma) // _LOOP_POINTS, 1)


def _number(found: Signature, name: str) -> float | None:
    """Return a quantity, None for one that was not measured."""
    value = getattr(found, name)
    if isinstance(value, float):
        return value
    return float(value.value) if value.seen else None
