"""The smallest moves: a push of one period, the jump of a ramp until it is noticed, and how well jumps repeat. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.detectable import detectable_jump
from positioner.reach.case import brake_ma, freeing_ma, slip_of

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.slip import Slip
    from positioner.laws.nmpc.lagged.valve import LaggedValve
    from positioner.reach.case import Case

_SHORTEST_S = 0.004
"""As in the law's plan: no slip is expected to be noticed sooner."""
_FRICTION_DOUBT = 0.005
"""How well F_c is known after some moves, as a part of it."""


@dataclass(frozen=True, slots=True)
class Jump:
    """The jump of the slowest ramp in m, when it is noticed in s, the ramp's rate in mA/s, σ of the landing in m."""

    jump_m: float
    noticed_s: float
    rate_ma_per_s: float
    landing_m: float


def smallest_push_m(case: Case, direction: float) -> float:
    """Return how far a stem moves that is freed for one period and the dead time, and then braked."""
    own, x = case.lagged(), case.middle_m
    slip = slip_of(own, direction)
    pressure_ma = converter_ma = freeing_ma(slip, x)
    here, v, stopped = x, 0.0, False
    for _ in range(own.delay_samples):
        if not stopped:
            here, v, pressure_ma, converter_ma, stopped = slip.after(here, v, pressure_ma, converter_ma, pressure_ma)
    if not stopped:
        stop_ma = brake_ma(case, slip, x)
        here = slip.stop_m(here, v, pressure_ma, converter_ma, pressure_ma, stop_ma)
    return direction * (here - x)


def smallest_jump(case: Case, direction: float) -> Jump:
    """Return the smallest jump of a ramp that the readings show in time, by the law's own plan."""
    own, x, sigma_m = case.lagged(), case.middle_m, case.sigma_m
    slip, settings = slip_of(own, direction), case.settings.lagged

    def jump(rate: float) -> tuple[float, float]:
        return detectable_jump(slip, own.sensor, x, rate, own.delay_samples, sigma_m, settings.brake_share)

    rise_ma = settings.ramp_share * own.gap_n / own.model.gain_n_per_ma
    slowest = rise_ma / max(2.0 * own.period_s, _SHORTEST_S)
    _, noticed_s = jump(slowest)
    rate = min(rise_ma / max(noticed_s, own.period_s), 3.0 * slowest)
    jump_m, noticed_s = jump(rate)
    return Jump(jump_m, noticed_s, rate, _landing_m(case, own, slip, rate, noticed_s))


def _landing_m(case: Case, own: LaggedValve, slip: Slip, rate: float, noticed_s: float) -> float:
    """Return σ of the place where a jump ends, in m.

    Two things are not known when the brake begins: when the stem slipped, and F_c. The readings until then tell them as
    well as their Fisher information allows; before them, the slip was at any time in `noticed_s`.
    """
    period_s, x = own.period_s, case.middle_m
    samples = max(round(noticed_s / period_s), 1) + own.delay_samples
    known = _Ramp(own, slip, x, rate, samples)
    easier_n = _STEP * slip.sliding_n
    easier = _Ramp(own, slip.with_sliding(slip.sliding_n - easier_n), x, rate, samples)
    information = 1.0 / (case.sigma_m * case.sigma_m)
    doubt_n = _FRICTION_DOUBT * max(slip.sliding_n, _LEAST_N)
    when, both, friction = 3.0 / (noticed_s * noticed_s), 0.0, 1.0 / (doubt_n * doubt_n)
    before = x
    for here, other in zip(known.seen, easier.seen, strict=True):
        by_time, by_friction = (here - before) / period_s, (other - here) / easier_n if easier_n else 0.0
        when += information * by_time * by_time
        both += information * by_time * by_friction
        friction += information * by_friction * by_friction
        before = here
    stop_ma = brake_ma(case, slip, known.x)
    place = known.stop_m(slip, 0.0, stop_ma)
    by_time = (known.stop_m(slip, _STEP * period_s, stop_ma) - place) / (_STEP * period_s)
    by_friction = (easier.stop_m(easier.slip, 0.0, stop_ma) - place) / easier_n if easier_n else 0.0
    variance = by_time * by_time * friction - 2.0 * by_time * by_friction * both + by_friction * by_friction * when
    return math.sqrt(max(variance / (when * friction - both * both), 0.0))


class _Ramp:
    """A slip on a ramp of pressure until the brake begins: what the sensor shows, and the state then."""

    def __init__(self, own: LaggedValve, slip: Slip, x: float, rate: float, samples: int) -> None:
        self.own, self.slip, drive, s = own, slip, own.drive, slip.direction
        pressure_ma = freeing_ma(slip, x)
        _, converter_ma = drive.ramp_ma(pressure_ma, s, rate)
        self.seen, self.v, self.acceleration = list[float](), 0.0, 0.0
        seen, stopped = x, False
        for _ in range(samples):
            if not stopped:
                current_ma, _ = drive.ramp_ma(pressure_ma, s, rate)
                here, v, pressure_ma, converter_ma, stopped = slip.after(
                    x, self.v, pressure_ma, converter_ma, current_ma
                )
                seen = own.sensor.after(x, here, seen)
                self.acceleration, self.v, x = (v - self.v) / own.period_s, v, here
            self.seen.append(seen)
        self.x, self.stopped, self.pressure_ma, self.converter_ma = x, stopped, pressure_ma, converter_ma

    def stop_m(self, slip: Slip, sooner_s: float, stop_ma: float) -> float:
        """Return where the stem stops if it slipped `sooner_s` before, with the same commands."""
        if self.stopped:
            return self.x
        x, v = self.x + self.v * sooner_s, self.v + self.acceleration * sooner_s
        first_ma = self.own.drive.command_ma(self.pressure_ma, self.converter_ma, stop_ma)
        return slip.stop_m(x, v, self.pressure_ma, self.converter_ma, first_ma, stop_ma)


_STEP = 1e-3
"""Step of the differences, as a part."""
_LEAST_N = 1.0
