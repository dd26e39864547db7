"""The lag of the position sensor: ẏ = (x - y)/τ_y, with x moving evenly within a sample. Pure."""

from __future__ import annotations

import math

from positioner.values import dataclass


@dataclass(frozen=True, slots=True)
class SensorLag:
    """A sensor in samples: `left` of its error stays after one; `behind`: how far it lags, as a part of a step of x."""

    left: float
    behind: float

    def after(self, before_x: float, after_x: float, seen: float) -> float:
        """Return what the sensor shows after a sample in which the stem moved from `before_x` to `after_x`."""
        return after_x + self.left * (seen - before_x) - self.behind * (after_x - before_x)


def sensor_lag(time_constant_s: float, period_s: float) -> SensorLag:
    """Return the lag of a sensor with this time constant; 0 is none."""
    if time_constant_s == 0.0:
        return SensorLag(0.0, 0.0)
    left = math.exp(-period_s / time_constant_s)
    return SensorLag(left, (1.0 - left) * time_constant_s / period_s)
