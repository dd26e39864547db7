"""How noisy the position sensor is, learned while the stem rests. Pure.

The average of n readings has 1/n of their variance only if the noise is white. The differences of successive means of
b = 1, 2, 4, ... readings (Allan's variance in octaves) show how large and how white the noise is: b times the variance
of means of b readings is the same at every b for white noise, and grows with b where the noise is held or wanders. The
largest of these values counts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from positioner.values import dataclass

OCTAVES = 9
"""The largest batch is 2^(OCTAVES - 1) readings."""
_PRIOR_PAIRS = 20.0
"""Weight of the configured noise, in pairs of readings."""
_PAIRS_KEPT = 4000.0
"""The sums are halved at this many pairs, so that the estimate follows a sensor that ages."""
_CONFIDENCE = 2.0
"""So many σ of its own error are subtracted from the variance of batches before it is compared."""
_PAIRS_TO_COUNT = 16.0
"""Fewer pairs of batches do not count."""


class Octave(NamedTuple):
    """Batches of one length: the mean that waits for its partner, the last mean, and the sums over pairs."""

    waiting: float | None = None
    previous: float | None = None
    squares: float = 0.0
    pairs: float = 0.0

    def followed_by(self, value: float, weight: float) -> Octave:
        """Return the octave after one more batch of `weight` readings with the mean `value`."""
        squares, pairs = self.squares, self.pairs
        if self.previous is not None:
            difference = value - self.previous
            squares, pairs = squares + 0.5 * weight * difference * difference, pairs + 1.0
            if pairs > _PAIRS_KEPT:
                squares, pairs = 0.5 * squares, 0.5 * pairs
        return Octave(value if self.waiting is None else None, value, squares, pairs)


@dataclass(frozen=True, slots=True)
class NoiseLevel:
    """Variance of the sensor relative to the configured one, as if its noise were white; 1 before anything is learned.

    It is rather too high than too low: with half the true noise, an average would seem far better than it is; with
    twice the noise, the law only waits a little longer.
    """

    octaves: tuple[Octave, ...] = (Octave(squares=_PRIOR_PAIRS, pairs=_PRIOR_PAIRS), *(Octave(),) * (OCTAVES - 1))
    ratio: float = 1.0

    def with_reading(self, reading: float) -> NoiseLevel:
        """Return the level after one more reading of a resting stem, in units of its configured σ."""
        octaves = list(self.octaves)
        value, weight = reading, 1.0
        for index, octave in enumerate(self.octaves):
            octaves[index] = octave.followed_by(value, weight)
            if octave.waiting is None:
                break
            value, weight = 0.5 * (octave.waiting + value), 2.0 * weight
        return NoiseLevel(tuple(octaves), _ratio(octaves))

    def at_new_place(self) -> NoiseLevel:
        """Return the level of a stem that rests at another place: the sums stay, but no pair spans the move."""
        return NoiseLevel(tuple(each._replace(waiting=None, previous=None) for each in self.octaves), self.ratio)


def _ratio(octaves: list[Octave]) -> float:
    """Return the largest of the octaves' variances, those of batches less the error they may have."""
    _, _, squares, pairs = octaves[0]
    largest = squares / pairs
    for _, _, squares, pairs in octaves[1:]:
        if pairs > _PAIRS_TO_COUNT:
            # successive pairs share a mean: their relative error is √(3/n)
            largest = max(largest, squares / pairs * (1.0 - _CONFIDENCE * math.sqrt(3.0 / pairs)))
    return largest
