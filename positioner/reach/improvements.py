"""What would improve a valve most: each single change, with the figures recomputed. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from positioner.reach.figures import figures_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.reach.case import Case
    from positioner.reach.figures import Figures

_FAST_S = 1e-3
_WORTH = 0.95
"""A change is worth a line if it brings σ of a first move, the mean error or the duration below this part."""


@dataclass(frozen=True, slots=True)
class Improvement:
    """A change, and the figures with it."""

    change: str
    figures: Figures


def improvements(case: Case, today: Figures) -> tuple[Improvement, ...]:
    """Return the changes that improve σ of a first move, mean error or duration, the best for the first one first."""
    found = [Improvement(change, figures_of(changed)) for change, changed in _changes(case)]
    worth = [each for each in found if _gain(each.figures, today) < _WORTH]
    return tuple(sorted(worth, key=lambda each: (each.figures.first_m, each.figures.mean_s)))


def _gain(changed: Figures, today: Figures) -> float:
    pairs = (
        (changed.first_m, today.first_m),
        (changed.error_m, today.error_m),
        (changed.mean_s, today.mean_s),
    )
    return min(after / before if 0.0 < before < math.inf else 1.0 for after, before in pairs)


def _changes(case: Case) -> Iterator[tuple[str, Case]]:
    valve, noise, actuator = case.valve, case.estimator, case.valve.actuator
    if case.sigma_m > 0.0:
        halved = replace(noise, noise_of_reading=noise.noise_of_reading / 2.0, noise_of_span=noise.noise_of_span / 2.0)
        yield "a position sensor with half the noise", replace(case, estimator=halved)
    if case.period_s > _FAST_S:
        yield f"a sample period of {_FAST_S * 1e3:g} ms", replace(case, period_s=_FAST_S)
    if actuator.fill_time_constant_s > 0.0:
        lags = replace(
            actuator,
            fill_time_constant_s=actuator.fill_time_constant_s / 2.0,
            vent_time_constant_s=actuator.vent_time_constant_s / 2.0,
        )
        yield "a volume booster that halves the lag", case.with_valve(actuator=lags)
    if actuator.converter_time_constant_s > 0.0:
        lags = replace(actuator, converter_time_constant_s=actuator.converter_time_constant_s / 2.0)
        yield "an I/P converter with half the lag", case.with_valve(actuator=lags)
    if actuator.slew_ma_per_s > 0.0:
        lags = replace(actuator, slew_ma_per_s=2.0 * actuator.slew_ma_per_s)
        yield "twice the air flow (slew limit)", case.with_valve(actuator=lags)
    if actuator.dead_time_s > 0.0:
        yield "half the dead time", case.with_valve(actuator=replace(actuator, dead_time_s=actuator.dead_time_s / 2.0))
    if valve.sensor_time_constant_s > 0.0:
        yield "a position sensor without lag", case.with_valve(sensor_time_constant_s=0.0)
    if valve.static_friction_n > valve.coulomb_friction_n:
        middle_n = (valve.static_friction_n + valve.coulomb_friction_n) / 2.0
        yield "a packing that sticks half as much (F_s - F_c)", case.with_valve(static_friction_n=middle_n)
