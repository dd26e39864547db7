"""What a procedure knows of the valve while it moves it: the line x(u) of the sliding stem, and the noise. Pure.

A sliding stem follows u = (F_0 + K·x ± F)/B. Sums over the sliding parts of two strokes give slope, middle and width of
this pair of lines; nothing of it needs the configured valve, but for a first guess.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.valve.parameters import ValveParameters

SMOOTHING_S = 0.01
"""Time constant of the smoothed reading."""
_FEWEST = 10
"""Sliding blocks that a line needs in each direction."""


@dataclass(frozen=True, slots=True)
class Moments:
    """Sums over points (u in mA, x in m): count, means, and the sums of squared and mixed deviations."""

    count: int = 0
    mean_ma: float = 0.0
    mean_m: float = 0.0
    ma_ma: float = 0.0
    ma_m: float = 0.0

    def add(self, current_ma: float, position_m: float) -> Moments:
        """Return the sums with one more point."""
        count = self.count + 1
        du, dx = current_ma - self.mean_ma, position_m - self.mean_m
        mean_ma, mean_m = self.mean_ma + du / count, self.mean_m + dx / count
        return Moments(
            count,
            mean_ma,
            mean_m,
            self.ma_ma + du * (current_ma - mean_ma),
            self.ma_m + du * (position_m - mean_m),
        )


@dataclass(frozen=True, slots=True)
class Line:
    """The sliding stem: travel per current in m/mA, the current that balances x = 0, and the friction in mA."""

    m_per_ma: float
    zero_ma: float
    friction_ma: float

    @classmethod
    def believed(cls, valve: ValveParameters) -> Line:
        """Return the line of the configured valve."""
        gain = valve.force_gain_n_per_ma
        return cls(
            gain / valve.spring_rate_n_per_m, valve.balance_current_ma(0.0), max(valve.coulomb_friction_n / gain, 0.01)
        )

    def balance_ma(self, position_m: float) -> float:
        """Return the current in mA in the middle of the stick band at `position_m`."""
        return self.zero_ma + position_m / self.m_per_ma


def line_of(up: Moments, down: Moments) -> Line | None:
    """Return the common line of two strokes; None where the stem has not slid far enough in both."""
    if min(up.count, down.count) < _FEWEST:
        return None
    slope = (up.ma_m + down.ma_m) / (up.ma_ma + down.ma_ma)
    if slope <= 0.0:
        return None
    up_ma, down_ma = (each.mean_ma - each.mean_m / slope for each in (up, down))
    return Line(slope, 0.5 * (up_ma + down_ma), max(0.5 * (up_ma - down_ma), 0.01))


@dataclass(frozen=True, slots=True)
class Mean:
    """A running mean of readings, and their scatter."""

    count: int = 0
    mean_m: float = 0.0
    squares_m2: float = 0.0

    def add(self, position_m: float) -> Mean:
        """Return the mean with one more reading."""
        count, off_m = self.count + 1, position_m - self.mean_m
        mean_m = self.mean_m + off_m / count
        return Mean(count, mean_m, self.squares_m2 + off_m * (position_m - mean_m))

    @property
    def sigma_m(self) -> float:
        """The standard deviation of a reading in m."""
        return math.sqrt(self.squares_m2 / (self.count - 1)) if self.count > 1 else 0.0
