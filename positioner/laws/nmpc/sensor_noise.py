"""How noisy the position sensor is, learned while the stem rests: its variance relative to the configured one. Pure.

The average of n readings has 1/n of their variance only if the noise is white. The differences of successive means of
b = 1, 2, 4, ... readings (Allan's variance in octaves) show how large and how white the noise is: b times the variance
of means of b readings is the same at every b for white noise, and grows with b where the noise is held or wanders. The
largest of these values counts: `Octave.largest` of the shortest batches.

It is rather too high than too low: with half the true noise, an average would seem far better than it is; with twice
the noise, the law only waits a little longer.
"""

from __future__ import annotations

import math

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
        own = _variance(self.batch, squares, pairs)
        largest = own if above is None else max(own, above.largest)
        return Octave(self.batch, above, squares, pairs, largest, value if waiting is None else None, value)

    def at_new_place(self) -> Octave:
        """Return the octave of a stem that rests at another place: the sums stay, but no pair spans the move."""
        above = None if self.above is None else self.above.at_new_place()
        return Octave(self.batch, above, self.squares, self.pairs, self.largest)


def _variance(batch: float, squares: float, pairs: float) -> float:
    """Return the variance of an octave, that of batches less the error it may have, and 0 where too little is known."""
    if batch == 1.0:
        return squares / pairs
    if pairs <= _PAIRS_TO_COUNT:
        return 0.0
    # successive pairs share a mean: their relative error is √(3/n)
    return squares / pairs * (1.0 - _CONFIDENCE * math.sqrt(3.0 / pairs))


def nothing_learned() -> Octave:
    """Return the octaves before anything is learned, the shortest batch first: the variance is the configured one."""
    octave: Octave | None = None
    for index in range(OCTAVES - 1, 0, -1):
        octave = Octave(float(1 << index), octave)
    return Octave(1.0, octave, _PRIOR_PAIRS, _PRIOR_PAIRS, 1.0)
