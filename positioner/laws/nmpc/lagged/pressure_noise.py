"""How noisy the pressure sensor is: from the differences of successive readings while the stem rests. Pure."""

from __future__ import annotations

from positioner.values import dataclass

_FEWEST, _MOST = 15, 2000
"""Differences before the noise is known, and over which it is averaged."""
_LEAST_MA2, _MOST_MA2 = 4e-6, 0.09
"""The least variance that is assumed; a sensor with more noise than 0.3 mA, 2 % of the loop's range, is not used."""


@dataclass(frozen=True, slots=True)
class PressureNoise:
    """seen_ma2: variance of a reading in mA², from so many `differences`. last_ma: the reading before, at rest."""

    seen_ma2: float = 0.0
    differences: int = 0
    last_ma: float | None = None

    @property
    def is_known(self) -> bool:
        """Whether readings can be used: their noise is known and not too large."""
        return self.differences >= _FEWEST and self.seen_ma2 < _MOST_MA2

    @property
    def variance_ma2(self) -> float:
        """Variance of a reading in mA²."""
        return max(self.seen_ma2, _LEAST_MA2)

    def at_rest(self, reading_ma: float) -> PressureNoise:
        """Return the noise after a reading while the stem rests."""
        if self.last_ma is None:
            return PressureNoise(self.seen_ma2, self.differences, reading_ma)
        change_ma, differences = reading_ma - self.last_ma, min(self.differences + 1, _MOST)
        seen_ma2 = self.seen_ma2 + (0.5 * change_ma * change_ma - self.seen_ma2) / differences
        return PressureNoise(seen_ma2, differences, reading_ma)

    def in_motion(self) -> PressureNoise:
        """Return the noise after a reading while the pressure moves."""
        return PressureNoise(self.seen_ma2, self.differences) if self.last_ma is not None else self
