"""The result of an identification: one row for each quantity, with unit and 95 % interval, and remarks. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from positioner.commissioning.units import PASCALS
from positioner.health.reference import kept_travel_m

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.commissioning.identified import IdentifiedValve, Interval
    from positioner.valve.parameters import ValveParameters

_SIGNAL_MA = 16.0
_OTHER_RESPONSE = 1.2
"""Mean square of the steps' residuals, over that of the noise."""


@dataclass(frozen=True, slots=True)
class Row:
    """One quantity: what it is, in which unit, value and ends of its interval."""

    name: str
    unit: str
    value: float
    low: float
    high: float
    seen: bool = True

    @classmethod
    def of(cls, name: str, unit: str, each: Interval, factor: float = 1.0) -> Row:
        """Return the row of an interval, `factor` times as large in this unit."""
        return cls(name, unit, each.value * factor, each.low * factor, each.high * factor, each.seen)

    def as_json(self) -> dict[str, Any]:
        """Return the row for a program; an end that is not known is None."""
        ends = {"low": self.low, "high": self.high}
        finite = {name: end if math.isfinite(end) else None for name, end in ends.items()}
        return {"name": self.name, "unit": self.unit, "value": self.value, **finite, "seen": self.seen}


def rows(found: IdentifiedValve, valve: ValveParameters, pressure_unit: str) -> tuple[Row, ...]:
    """Return the quantities in SI units, and then those of a workshop."""
    per_newton = 1.0 / (valve.diaphragm_area_m2 * PASCALS[pressure_unit])
    signal = 100.0 / (valve.force_gain_n_per_ma * _SIGNAL_MA)
    spring, preload = found.spring_rate_n_per_m, found.bench_set_n
    width = (
        100.0
        * (found.static_friction_n.value + found.coulomb_friction_n.value)
        / (valve.force_gain_n_per_ma * _SIGNAL_MA)
    )

    end_n = preload.value + spring.value * valve.span_m
    off_n = math.hypot(preload.high - preload.low, (spring.high - spring.low) * valve.span_m) / 2.0
    upper = Row(
        "bench set, at 100 %",
        pressure_unit,
        end_n * per_newton,
        (end_n - off_n) * per_newton,
        (end_n + off_n) * per_newton,
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
        Row.of("bench set, at 0 %", pressure_unit, preload, per_newton),
        upper,
        Row.of("static friction", pressure_unit, found.static_friction_n, per_newton),
        Row.of("sliding friction", pressure_unit, found.coulomb_friction_n, per_newton),
        Row.of("static friction", "% signal", found.static_friction_n, signal),
        Row.of("sliding friction", "% signal", found.coulomb_friction_n, signal),
        Row("stick band and dead band S", "% signal", width, width, width),
    )


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
        most_ms = 1e3 * max(found.fill_time_constant_s.high, found.vent_time_constant_s.high)
        lines.append(f"no lag was seen; one of more than {most_ms:.2g} ms would have been")
    if found.step_misfit > _OTHER_RESPONSE:
        lines.append(
            "the response to a step is not that of one lag and a dead time: a slew limit, a lag of the I/P converter "
            "or the sensor, backlash, or friction that depends on the place look so; the intervals do not hold then"
        )
    if found.misfit > 2.0:  # noqa: PLR2004 - 1 is a perfect fit
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
    }
