"""The pressure that follows the current: its motion within a sample, and the current that takes it where it should be.

Pressure p and the output w of the I/P converter are in mA, so that the force is B·p:
    ẇ = (u - w)/τ_c    and    ṗ = (w - p)/τ within ± the slew limit, τ = fill or vent by the sign of w - p.
The dead time is not here: `Pipeline` delays the currents. Pure.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.valve.actuator import ActuatorParameters

_LONGEST_STEP_S = 2.5e-4
"""A sample is computed in steps of at most this length."""
_HORIZON_OF_CONVERTER = 2.0
"""With a converter that lags, the pressure is to arrive after one period and so many of the converter's τ_c."""

_SLEWS = 0.999
"""A change of so much of the slew limit's is limited by it."""


@dataclass(frozen=True, slots=True)
class Drive:
    """An actuator in samples of `period_s`, each of `steps` steps of `step_s`.

    fill_step, vent_step, converter_step: the part of its way that each covers in a step; fill_arrival, vent_arrival,
    converter_arrival: until the pressure is to arrive. most_ma: the largest change of the pressure in a step.
    """

    period_s: float
    steps: int
    step_s: float
    fill_s: float
    vent_s: float
    converter_s: float
    most_ma: float
    low_ma: float
    high_ma: float
    fill_step: float
    vent_step: float
    converter_step: float
    fill_arrival: float
    vent_arrival: float
    converter_arrival: float

    def with_lag(self, scale: float) -> Drive:
        """Return the drive with fill and vent lags of `scale` times those of this one."""
        return self.with_lags(self.fill_s * scale, self.vent_s * scale)

    def with_lags(self, fill_s: float, vent_s: float) -> Drive:
        """Return the drive with these lags."""
        return _made(
            self.period_s,
            fill_s,
            vent_s,
            self.converter_s,
            self.slew_ma_per_s,
            self.low_ma,
            self.high_ma,
        )

    def with_reserve(self, share: float, slew_share: float) -> Drive:
        """Return the drive that leaves these shares unused: of the current's range at each end, of the slew limit."""
        reserve_ma = share * (self.high_ma - self.low_ma)
        return replace(
            self,
            low_ma=self.low_ma + reserve_ma,
            high_ma=self.high_ma - reserve_ma,
            most_ma=(1.0 - slew_share) * self.most_ma,
        )

    @property
    def fill_sample(self) -> float:
        """The part of its way that a rising pressure covers in a sample."""
        return _covered(self.period_s, self.fill_s)

    @property
    def slew_ma_per_s(self) -> float:
        """The highest rate of the pressure, infinity without a limit."""
        return self.most_ma / self.step_s

    def is_slewing(self, change_ma: float) -> bool:
        """Return whether it is the slew limit, and no lag, that makes this change of the pressure in a sample."""
        return abs(change_ma) >= _SLEWS * self.most_ma * self.steps

    def with_limit(self, high_ma: float) -> Drive:
        """Return the drive that gives no more than `high_ma`."""
        return replace(self, high_ma=high_ma)

    def step(self, pressure_ma: float, converter_ma: float, current_ma: float) -> tuple[float, float]:
        """Return pressure and converter output after one step of a sample under `current_ma`."""
        before_ma = converter_ma
        converter_ma += self.converter_step * (current_ma - converter_ma)
        driving_ma = converter_ma if self.converter_s == 0.0 else 0.5 * (before_ma + converter_ma)
        gap_ma = driving_ma - pressure_ma
        change_ma = (self.fill_step if gap_ma > 0.0 else self.vent_step) * gap_ma
        return pressure_ma + min(max(change_ma, -self.most_ma), self.most_ma), converter_ma

    def after(self, pressure_ma: float, converter_ma: float, current_ma: float) -> tuple[float, float]:
        """Return pressure and converter output after one sample under `current_ma`."""
        for _ in range(self.steps):
            pressure_ma, converter_ma = self.step(pressure_ma, converter_ma, current_ma)
        return pressure_ma, converter_ma

    def command_ma(self, pressure_ma: float, converter_ma: float, wanted_ma: float) -> float:
        """Return the deadbeat current D(p*) that takes the pressure to `wanted_ma`, as far as the loop can give it."""
        arrival = self.fill_arrival if wanted_ma > pressure_ma else self.vent_arrival
        current_ma = self.limited(pressure_ma + (wanted_ma - pressure_ma) / arrival)
        if self.converter_s == 0.0:
            return current_ma
        return self.limited(converter_ma + (current_ma - converter_ma) / self.converter_arrival)

    def ramp_ma(self, pressure_ma: float, direction: float, rate_ma_per_s: float) -> tuple[float, float]:
        """Return current and converter output of a pressure that changes steadily by ±`rate_ma_per_s`."""
        lag_s = self.fill_s if direction > 0.0 else self.vent_s
        converter_ma = pressure_ma + direction * rate_ma_per_s * lag_s
        lead_s = self.converter_s if lag_s + self.converter_s > 0.0 else self.period_s
        return self.limited(converter_ma + direction * rate_ma_per_s * lead_s), self.limited(converter_ma)

    def limited(self, current_ma: float) -> float:
        """Return the current inside the limits of the loop."""
        return min(max(current_ma, self.low_ma), self.high_ma)


def drive_of(actuator: ActuatorParameters, period_s: float, low_ma: float, high_ma: float) -> Drive:
    """Return the drive of `actuator` between these currents in mA."""
    slew = actuator.slew_ma_per_s if actuator.slew_ma_per_s > 0.0 else math.inf
    fill_s, vent_s, converter_s = (
        actuator.fill_time_constant_s,
        actuator.vent_time_constant_s,
        actuator.converter_time_constant_s,
    )
    return _made(period_s, fill_s, vent_s, converter_s, slew, low_ma, high_ma)


def _made(
    period_s: float, fill_s: float, vent_s: float, converter_s: float, slew: float, low_ma: float, high_ma: float
) -> Drive:
    steps = math.ceil(period_s / _LONGEST_STEP_S - 1e-9)
    step_s = period_s / steps
    arrival_s = period_s + _HORIZON_OF_CONVERTER * converter_s
    return Drive(
        period_s,
        steps,
        step_s,
        fill_s,
        vent_s,
        converter_s,
        slew * step_s,
        low_ma,
        high_ma,
        _covered(step_s, fill_s),
        _covered(step_s, vent_s),
        _covered(step_s, converter_s),
        _covered(arrival_s, fill_s),
        _covered(arrival_s, vent_s),
        _covered(period_s, converter_s),
    )


def _covered(duration_s: float, lag_s: float) -> float:
    """Return the part of its way that a first-order lag covers."""
    return 1.0 - math.exp(-duration_s / lag_s) if lag_s > 0.0 else 1.0
