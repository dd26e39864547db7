"""Curves of any length in bounded memory: the least and the largest value of equal parts of them. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

MOST_PARTS = 8192


class Envelope:
    """Several curves over one time; up to `parts` samples nothing is lost, and with more samples no peak."""

    def __init__(self, curves: int, parts: int = MOST_PARTS) -> None:
        """Begin with no sample; `parts` is an even number."""
        self._parts = parts
        self._time_s = np.full(parts, np.nan)
        self._low = np.full((parts, curves), np.nan)
        self._high = np.full((parts, curves), np.nan)
        self._per_part = 1
        self._samples = 0

    def append(self, time_s: float, values: Sequence[float | None]) -> None:
        """Add a sample of every curve; None stands for no value."""
        at, behind = divmod(self._samples, self._per_part)
        if at == self._parts:
            self._join_pairs()
            at = self._parts // 2
        if not behind:
            self._time_s[at] = time_s
        numbers = np.array([np.nan if value is None else value for value in values])
        self._low[at] = np.fmin(self._low[at], numbers)
        self._high[at] = np.fmax(self._high[at], numbers)
        self._samples += 1

    def lines(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return times (n,) in s, and values (n, curves), NaN for none; a part gives two points at its beginning."""
        used = -(-self._samples // self._per_part)
        if self._per_part == 1:
            return self._time_s[:used], self._low[:used]
        both = np.stack((self._low[:used], self._high[:used]), axis=1)
        return np.repeat(self._time_s[:used], 2), both.reshape(2 * used, -1)

    def _join_pairs(self) -> None:
        half = self._parts // 2
        self._time_s[:half] = self._time_s[::2]
        for joined, values in ((np.fmin, self._low), (np.fmax, self._high)):
            values[:half] = joined(values[::2], values[1::2])
            values[half:] = np.nan
        self._per_part *= 2
