"""A stem at rest: the average of its readings, and of what the sensor still lags behind. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.sensor_lag import SensorLag

_WEIGHT = 0.15
"""Of the newest innovation in the smoothed one."""
_SURPRISE = 4.5
"""Smoothed innovation, in its own σ, above which a resting stem must have moved."""
_LEAST_READINGS = 6


@dataclass(frozen=True, slots=True)
class LaggedRest:
    """The estimate of a stem at rest at x (m).

    gap: what the sensor shows beyond x. xx, xg, gg: covariance of both in m². drift_m: the smoothed innovation;
    readings: in it. settle_s: until the stem counts as resting. stays: its error was judged, and is not worth a move.
    """

    x: float
    xx: float
    gap: float = 0.0
    xg: float = 0.0
    gg: float = 0.0
    drift_m: float = 0.0
    readings: int = 0
    settle_s: float = 0.0
    stays: bool = False

    @property
    def sigma_m(self) -> float:
        """Standard deviation of x in m."""
        return math.sqrt(self.xx)

    def later(self, sensor: SensorLag, period_s: float) -> LaggedRest:
        """Return the rest one sample later."""
        left = sensor.left
        return LaggedRest(
            self.x,
            self.xx,
            left * self.gap,
            left * self.xg,
            left * left * self.gg,
            self.drift_m,
            self.readings,
            max(self.settle_s - period_s, 0.0),
            self.stays,
        )

    def averaged(self, measured_m: float, variance_m2: float) -> LaggedRest:
        """Return the rest after a reading with `variance_m2`; where the stem must have moved, a new average begins."""
        innovation = measured_m - self.x - self.gap
        xs, gs = self.xx + self.xg, self.xg + self.gg
        drift_m = self.drift_m + _WEIGHT * (innovation - self.drift_m)
        readings = self.readings + 1
        bound_m = _SURPRISE * math.sqrt(variance_m2 * _WEIGHT / (2.0 - _WEIGHT)) + 3.0 * math.sqrt(xs + gs)
        if readings > _LEAST_READINGS and abs(drift_m) > bound_m:
            return LaggedRest(
                self.x + drift_m, drift_m * drift_m + 0.1 * variance_m2, 0.0, 0.0, 0.0, 0.0, 0, self.settle_s
            )
        spread = xs + gs + variance_m2
        kx, kg = xs / spread, gs / spread
        return LaggedRest(
            self.x + kx * innovation,
            self.xx - kx * xs,
            self.gap + kg * innovation,
            self.xg - kx * gs,
            self.gg - kg * gs,
            drift_m,
            readings,
            self.settle_s,
            self.stays,
        )
