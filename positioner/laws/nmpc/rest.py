"""The readings of a stem that should rest: their mean, how sure it is, and whether the stem moves nevertheless. Pure.

Readings are gathered in blocks of 12 ms. Where the mean of the last blocks differs from that of those before by more
than noise explains, the stem has moved, and the gathering begins anew. So a rest that was believed too early, because
of a lag that nobody configured or a force that freed the stem, ends by itself.

Noise: the variance s² of readings at rest, and that of their differences, d = s² (1 - ρ), ρ the correlation of
neighbours. n readings are worth n (1 - ρ)/(1 + ρ) independent ones, as of a first-order process.
"""

from __future__ import annotations

import math

from positioner.values import dataclass

_BLOCK_S = 0.012
"""Short beside the motion of a stem, long beside a period at which readings are averaged at all."""
_LATE_BLOCKS = 10
"""At most so many last blocks, 0.12 s, are held against those before."""
_LATE_PART = 4
"""One block in four is a last one."""
_MOVED, _MOVED_M = 4.5, 1e-5
"""σ of the difference that a rest of an hour does not reach by chance, and what a quantised sensor may step by."""
_DIFFERS = 2.0
"""σ of the difference of two halves, from which on the second one is believed alone."""
_CONFIGURED = 8.0
"""The configured noise counts as so many readings."""
_FEWEST, _MOST, _KEPT = 8, 100, 300.0
"""Readings of a rest that say something of the noise, those that count of one rest, and of all rests together."""
_LEAST_M = 2e-5
"""σ of a reading is never taken for less: the finest resolution of position sensors."""
_MOST_CORRELATED = 0.98


@dataclass(frozen=True, slots=True)
class Noise:
    """What the rests so far have shown: readings, and their variances times that, of readings and of differences."""

    readings: float = 0.0
    squares_m2: float = 0.0
    steps_m2: float = 0.0

    def of(self, configured_m: float) -> tuple[float, float]:
        """Return the variance of a reading in m², and how many readings are worth one that is independent.

        configured_m: σ of a reading by the configuration.
        """
        own_m2 = configured_m * configured_m
        count = _CONFIGURED + self.readings
        variance_m2 = (own_m2 * _CONFIGURED + self.squares_m2) / count
        step_m2 = min((own_m2 * _CONFIGURED + self.steps_m2) / count, variance_m2)
        correlation = min(1.0 - step_m2 / variance_m2, _MOST_CORRELATED) if variance_m2 > 0.0 else 0.0
        return max(variance_m2, _LEAST_M * _LEAST_M), (1.0 + correlation) / (1.0 - correlation)

    def after(self, rest: Rest) -> Noise:
        """Return the noise with the readings of one more rest, where they are enough."""
        if rest.readings < _FEWEST:
            return self
        mean_m = rest.mean_m
        square_m2 = max(rest.squares_m2 / rest.readings - mean_m * mean_m, 0.0) * rest.readings / (rest.readings - 1)
        step_m2 = 0.5 * rest.steps_m2 / (rest.readings - 1)
        weight = float(min(rest.readings, _MOST))
        kept = min(1.0, _KEPT / (self.readings + 1.0))
        return Noise(
            self.readings * kept + weight,
            self.squares_m2 * kept + square_m2 * weight,
            self.steps_m2 * kept + step_m2 * weight,
        )


@dataclass(frozen=True, slots=True)
class Rest:
    """The readings since the stem rests: their number, sums of them, of squares and of squared steps, and the newest.

    block_m, block_readings: of the block that is not full. early_m, early_blocks: sum and number of the first means of
    blocks; late_m: the last ones, the newest last. duration_s: length.
    """

    readings: int = 0
    total_m: float = 0.0
    squares_m2: float = 0.0
    steps_m2: float = 0.0
    newest_m: float = 0.0
    block_m: float = 0.0
    block_readings: int = 0
    early_m: float = 0.0
    early_blocks: int = 0
    late_m: tuple[float, ...] = ()
    duration_s: float = 0.0

    @property
    def mean_m(self) -> float:
        """Mean of the readings; there is at least one."""
        return self.total_m / self.readings

    @property
    def blocks(self) -> int:
        """Number of full blocks."""
        return self.early_blocks + len(self.late_m)

    def read(self, measured_m: float, elapsed_s: float, period_s: float) -> tuple[Rest, bool]:
        """Return the rest with one more reading, and whether a block is full now."""
        step_m = measured_m - self.newest_m if self.readings else 0.0
        block_m, block_readings = self.block_m + measured_m, self.block_readings + 1
        early_m, early_blocks, late_m = self.early_m, self.early_blocks, self.late_m
        full = block_readings >= block_length(period_s)
        if full:
            late_m = (*late_m, block_m / block_readings)
            block_m, block_readings = 0.0, 0
            if len(late_m) > _LATE_BLOCKS:
                early_m, early_blocks, late_m = early_m + late_m[0], early_blocks + 1, late_m[1:]
        rest = Rest(
            self.readings + 1,
            self.total_m + measured_m,
            self.squares_m2 + measured_m * measured_m,
            self.steps_m2 + step_m * step_m,
            measured_m,
            block_m,
            block_readings,
            early_m,
            early_blocks,
            late_m,
            self.duration_s + elapsed_s,
        )
        return rest, full

    def moved_m(self, period_s: float, variance_m2: float, worth: float) -> float:
        """Return how far the stem has moved during this rest, 0 where noise explains it.

        Args:
            period_s: of the readings.
            variance_m2: of a reading.
            worth: how many readings are worth one that is independent.
        """
        count = self.blocks
        late = min(max(1, count // _LATE_PART), _LATE_BLOCKS, len(self.late_m))
        if count - late < 1:
            return 0.0
        _, gap_m, sigma_m = self._apart(late, period_s, variance_m2 * worth)
        return gap_m if abs(gap_m) > _MOVED * sigma_m + _MOVED_M else 0.0

    def latest(self, period_s: float, variance_m2: float, worth: float) -> tuple[float, int]:
        """Return the mean of the readings and their number; of the last ones alone where those before differ by 2 σ.

        The end of a slow motion is no rest yet, and too short to be seen as motion. Arguments as for `moved_m`.
        """
        late = min(max(1, self.blocks // 2), len(self.late_m))
        if self.blocks - late < 1:
            return self.mean_m, self.readings
        late_m, gap_m, sigma_m = self._apart(late, period_s, variance_m2 * worth)
        if abs(gap_m) < _DIFFERS * sigma_m:
            return self.mean_m, self.readings
        return late_m, late * block_length(period_s)

    def _apart(self, late: int, period_s: float, variance_m2: float) -> tuple[float, float, float]:
        """Return the mean of the last `late` blocks, by how much it exceeds that of those before, and σ of that."""
        early = self.blocks - late
        late_m = early_m = 0.0
        for place, block_m in enumerate(self.late_m):
            if place < len(self.late_m) - late:
                early_m += block_m
            else:
                late_m += block_m
        late_m /= late
        sigma_m = math.sqrt(variance_m2 * (1.0 / late + 1.0 / early) / block_length(period_s))
        return late_m, late_m - (early_m + self.early_m) / early, sigma_m


NO_REST = Rest()
"""Nothing was read yet."""


def block_length(period_s: float) -> int:
    """Return how many readings make a block."""
    return max(1, int(_BLOCK_S / period_s))
