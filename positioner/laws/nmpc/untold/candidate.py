"""Actuators as they may be: the pressure follows the current with a lag, or some samples later. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.laws.nmpc.untold.course import Piece

_LAGS_S = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3)
_LATE = (1, 2)
"""Dead times in samples."""
_SHORTEST = 0.4
"""A lag below this part of a sample is none."""
_STEPS_PER_SAMPLE = 2
_STEPS_PER_LAG = 6.0
_SETTLED_MA = 0.05
"""A pressure so near to the current follows it no more."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """An actuator: its lag in s, or its dead time in samples."""

    lag_s: float
    late: int = 0

    def after(self, pressure_ma: float, current_ma: float, duration_s: float) -> float:
        """Return the pressure in mA after `duration_s` under `current_ma`."""
        if self.lag_s == 0.0:
            return current_ma
        return current_ma + (pressure_ma - current_ma) * math.exp(-duration_s / self.lag_s)

    def mean(self, pressure_ma: float, current_ma: float, duration_s: float) -> float:
        """Return the mean pressure in mA over `duration_s` under `current_ma`."""
        if self.lag_s == 0.0:
            return current_ma
        share = -math.expm1(-duration_s / self.lag_s) * self.lag_s / duration_s
        return current_ma + (pressure_ma - current_ma) * share


@dataclass(frozen=True, slots=True)
class Pressures:
    """The pressure in a course, in steps: the piece that each belongs to, its length in s, its mean pressure in mA."""

    piece: list[int]
    length_s: list[float]
    mean_ma: list[float]
    end_ma: float


def candidates(period_s: float) -> tuple[Candidate, ...]:
    """Return the actuators to be compared at this sample period; the first one is immediate."""
    late = [Candidate(0.0, samples) for samples in _LATE]
    lags = [Candidate(lag_s) for lag_s in _LAGS_S if lag_s >= _SHORTEST * period_s]
    return (Candidate(0.0), *late, *lags)


def pressures(candidate: Candidate, pieces: tuple[Piece, ...], begin_ma: float, period_s: float) -> Pressures:
    """Return the pressures in a course that begins with the pressure `begin_ma`."""
    pressure_ma, waiting = begin_ma, [begin_ma] * candidate.late
    piece_of: list[int] = []
    lengths: list[float] = []
    means: list[float] = []
    for index, piece in enumerate(pieces):
        current_ma = piece.current_ma
        if candidate.late:
            waiting.append(current_ma)
            current_ma = waiting.pop(0)
            if piece.samples > 1:
                waiting = [piece.current_ma] * candidate.late
        count, length_s = 1, piece.samples * period_s
        if candidate.lag_s > 0.0 and abs(current_ma - pressure_ma) > _SETTLED_MA:
            finest_s = max(period_s / _STEPS_PER_SAMPLE, candidate.lag_s / _STEPS_PER_LAG)
            count = max(math.ceil(length_s / finest_s), _STEPS_PER_SAMPLE)
            length_s /= count
        for _ in range(count):
            piece_of.append(index)
            lengths.append(length_s)
            means.append(candidate.mean(pressure_ma, current_ma, length_s))
            pressure_ma = candidate.after(pressure_ma, current_ma, length_s)
    return Pressures(piece_of, lengths, means, pressure_ma)
