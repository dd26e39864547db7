"""Long records made drawable: the envelope of a curve. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_POINTS = 20_000
"""Points of a line in the picture; a longer one is drawn as its envelope."""


def envelope(
    time_s: NDArray[np.float64], values: NDArray[np.float64], most_points: int = MOST_POINTS
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the line, or for more than `most_points` the least and largest value of equal stretches of it.

    No peak is lost: each stretch gives two points at its beginning, shape (2 * stretches). NaN stands for no value.
    """
    if len(values) <= most_points:
        return time_s, values
    first = np.linspace(0, len(values), most_points // 2, endpoint=False).astype(np.intp)
    both = np.column_stack((np.fmin.reduceat(values, first), np.fmax.reduceat(values, first)))
    return np.repeat(time_s[first], 2), both.ravel()
