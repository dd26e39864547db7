"""A sticking valve behind a lag, by Euler's method in steps of 10 μs; it shares nothing with `positioner`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.valve.parameters import ValveParameters

_STEP_S = 1e-5


class EulerValve:
    """Forces over the gain B, in mA; every number may be changed. `sign`: the direction of the last slip.

    seen: what a sensor with the lag `sensor_s` shows.
    """

    def __init__(
        self,
        valve: ValveParameters,
        position_m: float,
        pressure_ma: float,
        *,
        period_s: float = 1e-3,
        sensor_s: float = 0.0,
    ) -> None:
        gain = valve.force_gain_n_per_ma
        self.spring, self.offset = valve.spring_rate_n_per_m / gain, valve.bench_set_n / gain
        self.static, self.sliding = valve.static_friction_n / gain, valve.coulomb_friction_n / gain
        self.mass, self.viscous = valve.mass_kg / gain, valve.viscous_friction_n_s_per_m / gain
        self.fill_s, self.vent_s = valve.actuator.fill_time_constant_s, valve.actuator.vent_time_constant_s
        self.period_s, self.sensor_s, self.seen = period_s, sensor_s, position_m
        self.x, self.v, self.p, self.stuck, self.sign = position_m, 0.0, pressure_ma, True, 1.0

    def sample(self, current_ma: float) -> float:
        """Return the place after a sample under a current."""
        for _ in range(round(self.period_s / _STEP_S)):
            self._step(current_ma)
            self.seen += (self.x - self.seen) * (_STEP_S / self.sensor_s if self.sensor_s else 1.0)
        return self.x

    def play(self, currents_ma: Iterable[float], hold_ma: float) -> float:
        """Return where the stem is after these currents, and eight lags and 60 ms of the last one."""
        for current_ma in currents_ma:
            self.sample(current_ma)
        for _ in range(round((8.0 * max(self.fill_s, self.vent_s) + 0.06) / self.period_s)):
            self.sample(hold_ma)
        return self.x

    def _step(self, current_ma: float) -> None:
        lag_s = self.fill_s if current_ma > self.p else self.vent_s
        self.p = self.p + (current_ma - self.p) * _STEP_S / lag_s if lag_s > 0.0 else current_ma
        push = self.p - self.spring * self.x - self.offset
        if self.stuck:
            if abs(push) <= self.static:
                return
            self.stuck, self.sign = False, math.copysign(1.0, push)
        self.v += (push - self.sign * self.sliding - self.viscous * self.v) * _STEP_S / self.mass
        if self.v * self.sign <= 0.0:
            self.v, self.stuck = 0.0, True
        self.x += self.v * _STEP_S
