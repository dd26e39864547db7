"""What a position sensor with a lag shows of a stem, sample by sample. Pure.

ż = (x - z)/τ,    x evenly from x_0 to x_1 in a sample T:
z_1 = e z_0 + (1 - e)(w x_0 + (1 - w) x_1),    e = e^(-T/τ),    w = τ/T - e/(1 - e)
"""

from __future__ import annotations

from positioner.values import dataclass
from positioner.valve.actuator import left_of_lag


@dataclass(frozen=True, slots=True)
class SensorLag:
    """left: e; early: w, a little less than a half behind a long lag, 0 without one."""

    left: float = 0.0
    early: float = 0.0

    def shown_m(self, before_m: float, here_m: float) -> float:
        """Return the place in m to which the reading goes while the stem goes from one place to another."""
        return here_m + self.early * (before_m - here_m)

    def after(self, before_m: float, here_m: float, seen_m: float) -> float:
        """Return the reading in m after a sample in which the stem goes from one place to another."""
        shown_m = self.shown_m(before_m, here_m)
        return shown_m + (seen_m - shown_m) * self.left


NO_LAG = SensorLag()


def sensor_lag(time_constant_s: float, period_s: float) -> SensorLag:
    """Return the lag of a sensor in samples of this period."""
    if time_constant_s <= 0.0:
        return NO_LAG
    left = left_of_lag(period_s, time_constant_s)
    return SensorLag(left, time_constant_s / period_s - left / (1.0 - left))
