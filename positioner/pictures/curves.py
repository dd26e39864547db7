"""The envelope of a long curve: few enough points to draw. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_POINTS = 4000
"""Points of a line in the picture; of a line with more points the envelope is drawn."""


def envelope(
    time_s: NDArray[np.float64], values: NDArray[np.float64], most_points: int = MOST_POINTS
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the line, or for more than `most_points` the least and largest value of equal parts of it.

    No peak is lost: each part gives two points at its beginning, shape (2 * parts). NaN stands for no value.
    """
    if len(values) <= most_points:
        return time_s, values
    first = np.linspace(0, len(values), most_points // 2, endpoint=False).astype(np.intp)
    both = np.column_stack((np.fmin.reduceat(values, first), np.fmax.reduceat(values, first)))
    return np.repeat(time_s[first], 2), both.ravel()
