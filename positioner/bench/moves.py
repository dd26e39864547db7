"""When the stem moves in a run, and the parts of the time axis that show it. Pure.

A move of some milliseconds is a vertical line on the axis of a whole run. Each part here begins a little before the
motion and ends a little after it: at least `MOTION_SHARE` of it is motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.bench.trend import TrendData

    Array = NDArray[np.float64]

MOTION_SHARE = 0.6
"""The least part of a window in which the stem moves."""
TELLING_OF_SPAN = 0.005
"""A move of less travel, as a part of the span, is a correction that shows little."""
_STILL_SPANS_PER_S = 1e-3
"""Slower than this the stem counts as still."""
_LEAST_M = 2e-8
"""Two steps of the frame of the true position."""
_MARGIN, _LEAST_MARGIN = 4, 3
"""Samples of motion for one sample of rest on each side; the fewest samples of motion that have one."""


@dataclass(frozen=True, slots=True)
class Window:
    """The samples `first` to `last` of a run, both shown; the stem moves from `begin` to `end`, at times perhaps not.

    moving: sample periods of motion. travel_m: the way from the first to the last place.
    """

    first: int
    last: int
    begin: int
    end: int
    moving: int
    travel_m: float

    @property
    def motion_share(self) -> float:
        """The part of the window in which the stem moves."""
        return self.moving / max(self.last - self.first, 1)


@dataclass(frozen=True, slots=True)
class Breakaway:
    """Γ in mA, and the beginning of its move in s."""

    begun_s: float
    current_ma: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MovesData:
    """The data of the picture: those of the trend, and of the moves.

    shown: the windows of the moves in the picture; count: how many moves there are. predicted: for each window
    the positions in m by what the law knew when the move began, NaN where there is none.
    """

    trend: TrendData
    shown: tuple[Window, ...]
    count: int
    predicted: tuple[Array, ...]
    breakaways: tuple[Breakaway, ...]


def windows(position_m: Array, span_m: float, period_s: float) -> tuple[Window, ...]:
    """Return a window for each move; slides that follow each other closely are one move.

    Args:
        position_m: the true positions, shape (n,); NaN where none is known.
        span_m: length of 100 %.
        period_s: time between two of them.
    """
    still_m = max(_STILL_SPANS_PER_S * span_m * period_s, _LEAST_M)
    slides = _runs(np.abs(np.diff(position_m)) > still_m)
    joined: list[tuple[int, int, int]] = []
    for begin, end in slides:
        if joined and _share(joined[-1][0], end, joined[-1][2] + end - begin) >= MOTION_SHARE:
            first, _, moving = joined.pop()
            joined.append((first, end, moving + end - begin))
        else:
            joined.append((begin, end, end - begin))
    return tuple(_window(position_m, *each) for each in joined)


def telling(found: Sequence[Window], span_m: float, most: int) -> tuple[Window, ...]:
    """Return at most so many moves in their order: the first that tell something, then the largest of the others."""
    large = [each for each in found if abs(each.travel_m) >= TELLING_OF_SPAN * span_m][:most]
    others = sorted((each for each in found if each not in large), key=lambda each: -abs(each.travel_m))
    if len(large) < most:
        large += [each for each in others if abs(each.travel_m) < TELLING_OF_SPAN * span_m][: most - len(large)]
    return tuple(sorted(large, key=lambda each: each.first))


def _runs(moves: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last sample of each motion."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], moves, [False]))))
    return [(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]


def _share(begin: int, end: int, moving: int) -> float:
    return moving / (end - begin + 2 * _margin(end - begin))


def _margin(samples: int) -> int:
    return max(samples // _MARGIN, min(samples // _LEAST_MARGIN, 1))


def _window(position_m: Array, begin: int, end: int, moving: int) -> Window:
    margin = _margin(end - begin)
    first, last = max(begin - margin, 0), min(end + margin, len(position_m) - 1)
    return Window(first, last, begin, end, moving, float(position_m[end] - position_m[begin]))
