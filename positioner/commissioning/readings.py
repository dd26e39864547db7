"""Readings of a record, of which some are lost (NaN): their running mean, and none lost any more. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def smooth(values: Array, width: int) -> Array:
    """Return the mean over `width` samples around each one, shape (samples,); a lost reading does not count."""
    known = ~np.isnan(values)
    sums = np.r_[0.0, np.cumsum(np.where(known, values, 0.0))]
    counts = np.r_[0, np.cumsum(known)]
    at = np.arange(len(values))
    low, high = np.maximum(at - (width - 1) // 2, 0), np.minimum(at + width // 2 + 1, len(values))
    return np.asarray((sums[high] - sums[low]) / np.maximum(counts[high] - counts[low], 1))


def filled(readings: Array) -> Array:
    """Return readings in which each lost one is the one before; lost ones at the beginning stay so."""
    numbers = np.maximum.accumulate(np.where(np.isnan(readings), 0, np.arange(len(readings))))
    return np.asarray(readings[numbers])
