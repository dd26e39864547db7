"""Turning points of the stem, and its travel: what noise moves to and fro within a dead band does not count. Pure."""

from __future__ import annotations

from positioner.values import dataclass


@dataclass(frozen=True, slots=True)
class Turns:
    """The motion since the last turning point.

    turned_m: the last turning point, or where counting began. farthest_m: the farthest place from there since.
    direction: +1 while the stem opens, -1 while it closes, 0 before the first motion.
    """

    turned_m: float
    farthest_m: float
    direction: int = 0

    def moved(self, position_m: float, dead_band_m: float) -> tuple[Turns, float | None]:
        """Return the motion with the stem at `position_m`, and the span in m that a reversal ends, None without one.

        The stem has reversed at the farthest place when it is farther from there than the dead band.
        """
        direction = self.direction
        if direction == 0:
            away_m = position_m - self.turned_m
            if abs(away_m) <= dead_band_m:
                return self, None
            return Turns(self.turned_m, position_m, 1 if away_m > 0.0 else -1), None
        beyond_m = (position_m - self.farthest_m) * direction
        if beyond_m > 0.0:
            return Turns(self.turned_m, position_m, direction), None
        if -beyond_m <= dead_band_m:
            return self, None
        return Turns(self.farthest_m, position_m, -direction), abs(self.farthest_m - self.turned_m)
