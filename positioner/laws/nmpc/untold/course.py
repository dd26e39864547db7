"""What acted on the stem in a move, and what was read: single samples, at rest joined to ever longer pieces. Pure."""

from __future__ import annotations

import math

from positioner.values import dataclass

_SAME_MA = 0.03
"""Currents that differ by less count as the same one: the pressure follows their mean."""
_LONGER_EVERY = 4
"""A piece may have one sample more for so many samples under the same current."""
_FAR, _FAR_M = 5.0, 2e-4
"""A stem has moved that is so many standard deviations, and so far, from its origin."""
MOST_PIECES, _MOST_SAMPLES = 96, 600
"""A course with more of either is too long to tell anything."""


@dataclass(frozen=True, slots=True)
class Piece:
    """So many samples in a row: their mean current in mA, and the mean of the readings at their ends in m."""

    samples: int
    current_ma: float
    reading_m: float


@dataclass(frozen=True, slots=True)
class Course:
    """A push and what followed.

    origin_m: where the stem rested before it, with the variance in m². direction: ±1, of the push. pieces: since the
    push. same: samples in a row under the present current. samples: in all pieces. is_probe: the push was held.
    """

    origin_m: float
    variance_m2: float
    direction: float
    pieces: tuple[Piece, ...] = ()
    same: int = 0
    samples: int = 0
    is_probe: bool = False

    @property
    def is_too_long(self) -> bool:
        """Whether so much has happened that it tells nothing."""
        return len(self.pieces) >= MOST_PIECES or self.samples > _MOST_SAMPLES

    @property
    def moved_m(self) -> float:
        """How far from the origin the last readings are."""
        return self.pieces[-1].reading_m - self.origin_m

    def followed_by(self, current_ma: float, reading_m: float) -> Course:
        """Return the course one sample later."""
        pieces, same = joined(self.pieces, self.same, current_ma, reading_m)
        return Course(self.origin_m, self.variance_m2, self.direction, pieces, same, self.samples + 1, self.is_probe)


@dataclass(frozen=True, slots=True)
class Finished:
    """A course that is over. between: the time before it. noise_m2: of its readings."""

    course: Course
    between: tuple[Piece, ...]
    noise_m2: float

    @property
    def has_moved(self) -> bool:
        """Whether the stem has certainly moved."""
        sigma_m = math.sqrt(self.course.variance_m2 + self.noise_m2 / self.course.pieces[-1].samples)
        return abs(self.course.moved_m) > _FAR * sigma_m + _FAR_M

    def before(self, next_one: Finished) -> Finished:
        """Return the next course with this one as a part of the time before it."""
        between = (*self.between, *self.course.pieces, *next_one.between)[-MOST_PIECES:]
        return Finished(next_one.course, between, next_one.noise_m2)


def joined(pieces: tuple[Piece, ...], same: int, current_ma: float, reading_m: float) -> tuple[tuple[Piece, ...], int]:
    """Return the pieces after one more sample, and how many samples in a row have its current; `same` had the last."""
    if not pieces:
        return (Piece(1, current_ma, reading_m),), 1
    last = pieces[-1]
    same = same + 1 if abs(current_ma - last.current_ma) < _SAME_MA else 1
    if len(pieces) < MOST_PIECES and (same == 1 or last.samples * _LONGER_EVERY >= same):
        return (*pieces, Piece(1, current_ma, reading_m)), same
    count = last.samples + 1
    mean_ma = last.current_ma + (current_ma - last.current_ma) / count
    mean_m = last.reading_m + (reading_m - last.reading_m) / count
    return (*pieces[:-1], Piece(count, mean_ma, mean_m)), same
