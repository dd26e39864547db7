"""How noisy the position sensor is, learned while the stem rests: its variance relative to the configured one. Pure.

The average of n readings has 1/n of their variance only if the noise is white. `correlated_noise` knows noise of which
each value remembers the one before. Noise that wanders in any other way shows in the differences of successive means of
b = 16, 32, ... readings (Allan's variance in octaves): b times the variance of means of b readings is the same at every
b for white noise, and grows with b where the noise wanders. The largest of these values counts.

It is rather too high than too low: with half the true noise, an average would seem far better than it is; with twice
the noise, the law only waits a little longer.
"""

from __future__ import annotations

import math
from dataclasses import field

from positioner.laws.nmpc.correlated_noise import CorrelatedNoise
from positioner.values import dataclass

_SHORTEST, _OCTAVES = 16, 5
"""Readings in the shortest batch, and the number of octaves from there on."""
_PAIRS_KEPT = 4000.0
"""The sums are halved at this many pairs, so that the estimate follows a sensor that ages."""
_CONFIDENCE = 2.0
"""So many σ of its own error are subtracted from the variance of batches before it is compared."""
_PAIRS_TO_COUNT = 16.0
"""Fewer pairs of batches do not count."""
_LEAST_NOISE = 1e-6
"""The least variance that is assumed of a sensor, as a part of the configured one."""


@dataclass(frozen=True, slots=True)
class Octave:
    """Batches of one length: the mean that waits for its partner, the last mean, and the sums over pairs.

    batch: readings in a batch, each in units of the configured σ. above: the octave of batches twice as long.
    largest: the largest variance in this octave and those above it, as if the noise were white.
    """

    batch: float
    above: Octave | None = None
    squares: float = 0.0
    pairs: float = 0.0
    largest: float = 0.0
    waiting: float | None = None
    previous: float | None = None

    def followed_by(self, value: float) -> Octave:
        """Return the octave after one more batch with the mean `value`."""
        squares, pairs, above, waiting = self.squares, self.pairs, self.above, self.waiting
        if self.previous is not None:
            difference = value - self.previous
            squares, pairs = squares + 0.5 * self.batch * difference * difference, pairs + 1.0
            if pairs > _PAIRS_KEPT:
                squares, pairs = 0.5 * squares, 0.5 * pairs
        if waiting is not None and above is not None:
            above = above.followed_by(0.5 * (waiting + value))
        own = _variance(squares, pairs)
        largest = own if above is None else max(own, above.largest)
        return Octave(self.batch, above, squares, pairs, largest, value if waiting is None else None, value)

    def at_new_place(self) -> Octave:
        """Return the octave of a stem that rests at another place: the sums stay, but no pair spans the move."""
        above = None if self.above is None else self.above.at_new_place()
        return Octave(self.batch, above, self.squares, self.pairs, self.largest)


def _variance(squares: float, pairs: float) -> float:
    """Return the variance of an octave less the error that it may have, and 0 where too little is known."""
    if pairs <= _PAIRS_TO_COUNT:
        return 0.0
    # successive pairs share a mean: their relative error is √(3/n)
    return squares / pairs * (1.0 - _CONFIDENCE * math.sqrt(3.0 / pairs))


def _no_octaves() -> Octave:
    octave: Octave | None = None
    for index in range(_OCTAVES - 1, -1, -1):
        octave = Octave(float(_SHORTEST << index), octave)
    assert octave is not None  # noqa: S101 - there are octaves
    return octave


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """What is known of the noise: `rests`, as correlated noise; `slow`, by octaves, of which `total` waits for a batch.

    averaged: variance of the mean of n readings, times n. of_reading: variance of one reading. Both in units of the
    configured one.
    """

    rests: CorrelatedNoise = field(default_factory=CorrelatedNoise)
    slow: Octave = field(default_factory=_no_octaves)
    total: float = 0.0
    waiting: int = 0
    averaged: float = 13.0
    of_reading: float = 1.0

    def followed_by(self, value: float) -> SensorNoise:
        """Return the noise after one more reading of the resting stem, in units of the configured σ."""
        rests, slow = self.rests.followed_by(value), self.slow
        total, waiting = self.total + value, self.waiting + 1
        if waiting == _SHORTEST:
            slow, total, waiting = slow.followed_by(total / _SHORTEST), 0.0, 0
        return SensorNoise(rests, slow, total, waiting, max(rests.averaged, slow.largest), rests.of_reading)

    def at_new_place(self) -> SensorNoise:
        """Return the noise of a stem that rests at another place."""
        return SensorNoise(self.rests.at_new_place(), self.slow.at_new_place(), 0.0, 0, self.averaged, self.of_reading)

    def averaged_m2(self, sigma_m: float) -> float:
        """Return the variance of the mean of n readings, times n, in m²; `sigma_m` is the configured σ of one."""
        return max(self.averaged, _LEAST_NOISE) * sigma_m * sigma_m


def as_configured() -> SensorNoise:
    """Return the noise before anything is learned, believed to be white until it shows itself."""
    return SensorNoise(CorrelatedNoise(averaged=1.0), averaged=1.0)
