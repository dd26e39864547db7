"""The result of an identification: one row for each quantity, with unit and 95 % interval, and remarks. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from positioner.commissioning.identified import Interval
from positioner.commissioning.units import PASCALS
from positioner.health.reference import kept_travel_m
from positioner.inputs.durations import duration

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.commissioning.identified import IdentifiedValve
    from positioner.valve.parameters import ValveParameters

EXTRAPOLATED = "extrapolated"
"""The note of a value at a place that the stem did not come to."""
_SIGNAL_MA = 16.0
_SAME_OF_SPAN = 0.01
"""Of the span: a place that is no farther away was reached."""
_OTHER_RESPONSE = 1.2
"""Mean square of the steps' residuals, over that of the noise."""


@dataclass(frozen=True, slots=True)
class Row:
    """One quantity: what it is, in which unit, value and ends of its interval.

    seen: false where nothing was measured; note: how the value was found, where it was not simply measured.
    """

    name: str
    unit: str
    value: float
    low: float
    high: float
    seen: bool = True
    note: str = ""

    @classmethod
    def exact(cls, name: str, unit: str, value: float) -> Row:
        """Return the row of a value without an interval; NaN is one that was not measured."""
        return cls(name, unit, value, value, value, seen=not math.isnan(value))

    @classmethod
    def of(cls, name: str, unit: str, each: Interval, factor: float = 1.0) -> Row:
        """Return the row of an interval, `factor` times as large in this unit."""
        return cls(name, unit, each.value * factor, each.low * factor, each.high * factor, each.seen)

    def as_json(self) -> dict[str, Any]:
        """Return the row for a program; a number that is not known or was not measured is None."""
        numbers = {"value": self.value, "low": self.low, "high": self.high}
        finite = {name: each if self.seen and math.isfinite(each) else None for name, each in numbers.items()}
        return {"name": self.name, "unit": self.unit, **finite, "seen": self.seen, "note": self.note}


def rows(found: IdentifiedValve, valve: ValveParameters, pressure_unit: str) -> tuple[Row, ...]:
    """Return the quantities in SI units, and then those of a workshop."""
    per_newton = 1.0 / (valve.diaphragm_area_m2 * PASCALS[pressure_unit])
    signal = 100.0 / (valve.force_gain_n_per_ma * _SIGNAL_MA)
    spring, preload = found.spring_rate_n_per_m, found.bench_set_n
    is_known = found.static_friction_n.seen and found.coulomb_friction_n.seen
    width = (
        100.0
        * (found.static_friction_n.value + found.coulomb_friction_n.value)
        / (valve.force_gain_n_per_ma * _SIGNAL_MA)
    )
    return (
        Row.of("spring rate", "N/m", spring),
        Row.of("spring force at 0", "N", preload),
        Row.of("static friction", "N", found.static_friction_n),
        Row.of("sliding friction", "N", found.coulomb_friction_n),
        Row.of("viscous friction", "N s/m", found.viscous_friction_n_s_per_m),
        Row.of("Stribeck velocity", "mm/s", found.stribeck_velocity_m_per_s, 1e3),
        Row.of("lag, filling", "ms", found.fill_time_constant_s, 1e3),
        Row.of("lag, venting", "ms", found.vent_time_constant_s, 1e3),
        Row.of("dead time", "ms", found.dead_time_s, 1e3),
        Row.of("noise, part of the reading", "%", found.noise_of_reading, 100.0),
        Row.of("noise, part of the span", "%", found.noise_of_span, 100.0),
        *bench_set(spring, preload, valve, pressure_unit),
        Row.of("static friction", pressure_unit, found.static_friction_n, per_newton),
        Row.of("sliding friction", pressure_unit, found.coulomb_friction_n, per_newton),
        Row.of("static friction", "% signal", found.static_friction_n, signal),
        Row.of("sliding friction", "% signal", found.coulomb_friction_n, signal),
        Row.exact("stick band and dead band S", "% signal", width if is_known else math.nan),
    )


def bench_set(
    spring: Interval, preload: Interval, valve: ValveParameters, unit: str, reached_m: tuple[float, float] | None = None
) -> tuple[Row, Row]:
    """Return the force of the spring at 0 and at 100 % of the travel, as the pressure that balances it.

    reached_m: the ends of what the stem has moved over; a force beyond them is extrapolated.
    """
    per_newton = 1.0 / (valve.diaphragm_area_m2 * PASCALS[unit])
    off_n = math.hypot(preload.high - preload.low, (spring.high - spring.low) * valve.span_m) / 2.0
    end_n = preload.value + spring.value * valve.span_m
    seen = spring.seen and preload.seen
    rows = []
    for place_m, part, found in (
        (0.0, "0", preload),
        (valve.span_m, "100", Interval(end_n, end_n - off_n, end_n + off_n, seen)),
    ):
        row = Row.of(f"bench set, at {part} %", unit, found, per_newton)
        near_m = _SAME_OF_SPAN * valve.span_m
        inside = reached_m is None or reached_m[0] - near_m <= place_m <= reached_m[1] + near_m
        rows.append(row if inside else replace(row, note=EXTRAPOLATED))
    return rows[0], rows[1]


def unseen(quantities: Sequence[Row]) -> tuple[str, ...]:
    """Return a line that names what the experiment did not show, nothing where it has shown all."""
    names = dict.fromkeys(row.name for row in quantities if not row.seen)
    return (f"not shown by this experiment, so the configured value is kept: {', '.join(names)}",) if names else ()


def remarks(found: IdentifiedValve) -> tuple[str, ...]:
    """Return what a person should know besides the values, a line each."""
    lines = [f"from {found.breakaways} breakaways and {found.steps} steps"]
    if found.friction_scatter > 0.01:  # noqa: PLR2004 - per cent
        lines.append(f"the friction scatters by {100.0 * found.friction_scatter:.1f} % from slip to slip")
    if found.noise_correlation > 1.0:
        lines.append("the noise of neighbouring readings is alike: the position is known less well than it seems")
    if found.fill_time_constant_s.value == 0.0:
        most_s = max(found.fill_time_constant_s.high, found.vent_time_constant_s.high)
        lines.append(f"no lag was seen; one of more than {duration(most_s, 2)} would have been")
    if found.step_misfit > _OTHER_RESPONSE:
        lines.append(
            "the response to a step is not that of one lag and a dead time: a slew limit, a lag of the I/P converter "
            "or the sensor, backlash, or friction that depends on the place look so; the intervals do not hold then"
        )
    for each in found.unexplained:
        off, most = (f"{1e3 * length_m:.2f} mm" for length_m in (each.off_m, each.most_m))
        lines.append(f"not explained: {each}: the readings are {off} off the fitted valve (RMS), at most {most} is")
    if found.misfit > 2.0 and not found.unexplained:  # noqa: PLR2004 - 1 is a perfect fit
        lines.append(
            f"the readings differ from the fitted valve by {math.sqrt(found.misfit):.1f} times their noise: "
            "look at the picture before you trust the values"
        )
    return tuple(lines)


def as_json(found: IdentifiedValve, valve: ValveParameters, pressure_unit: str) -> dict[str, Any]:
    """Return the result for a program: the keys of a configuration, the rows, and the remarks."""
    quantities = rows(found, valve, pressure_unit)
    return {
        "valve": valve.id,
        "travel_m": kept_travel_m(valve),
        "configuration": found.tables(),
        "rows": [row.as_json() for row in quantities],
        "remarks": [*remarks(found), *unseen(quantities)],
        "friction_scatter": found.friction_scatter,
        "noise_correlation": found.noise_correlation,
        "misfit": found.misfit,
        "step_misfit": found.step_misfit,
        "explained": not found.unexplained,
        "residuals": [each.as_json() for each in found.parts],
    }
