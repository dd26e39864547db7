"""The responses of each size side by side: medians, ranges, and the response region. Pure.

Regions (ISA-TR75.25.02): A no motion, B some motion, C consistent dynamics in proportion to the step, D limited by the
speed of the valve.
"""

from __future__ import annotations

import math
from itertools import pairwise
from statistics import median
from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.commissioning.step.response import Figures

QUANTITIES = ("dead_time_s", "t63_s", "t86_s", "t98_s", "overshoot", "gain")
_CONSISTENT = 0.2
"""Largest difference of the gain from that of the largest step, in region C."""
_SLEWS = 0.7
"""The part of a growth in proportion to the step from which on the speed is limited."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Median and range of a figure over `count` responses; NaN where there is none."""

    median: float
    low: float
    high: float
    count: int

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Return the spread of the values that are numbers."""
        kept = [value for value in values if not math.isnan(value)]
        if not kept:
            return cls(math.nan, math.nan, math.nan, 0)
        return cls(median(kept), min(kept), max(kept), len(kept))


@dataclass(frozen=True, slots=True)
class SizeRow:
    """The responses of one size in one direction; the spreads in the order of QUANTITIES."""

    size: float
    direction: float
    count: int
    moved: int
    spreads: tuple[Spread, ...]

    def spread(self, name: str) -> Spread:
        """Return the spread of one of QUANTITIES."""
        return self.spreads[QUANTITIES.index(name)]


def rows_of(figures: Sequence[Figures]) -> tuple[SizeRow, ...]:
    """Return a row for each size and direction, in the order of the test."""
    rows = []
    for size, direction in dict.fromkeys((each.size, each.direction) for each in figures):
        chosen = [each for each in figures if (each.size, each.direction) == (size, direction)]
        moved = [each for each in chosen if each.moved]
        spreads = [Spread.of([float(getattr(each, name)) for each in moved]) for name in QUANTITIES]
        rows.append(SizeRow(size, direction, len(chosen), len(moved), tuple(spreads)))
    return tuple(rows)


def regions_of(rows: Sequence[SizeRow]) -> dict[float, str]:
    """Return the region of each size, in the order of the rows."""
    sizes = sorted({row.size for row in rows})
    moving = [row for row in rows if row.moved == row.count and row.size == sizes[-1]]
    reference = median([row.spread("gain").median for row in moving]) if moving else math.nan
    regions = {size: _region([row for row in rows if row.size == size], reference) for size in sizes}
    # the speed is a limit from some size on: beyond it every larger step takes longer
    for small, large in reversed(list(pairwise(sizes))):
        growth = 1.0 + _SLEWS * (large / small - 1.0)
        if not regions[small] == regions[large] == "C" or _way_s(rows, large) < growth * _way_s(rows, small):
            break
        regions[large] = "D"
    return regions


def _way_s(rows: Sequence[SizeRow], size: float) -> float:
    """Return the longest time from the first motion to T86, in s."""
    return max(row.spread("t86_s").median - row.spread("dead_time_s").median for row in rows if row.size == size)


def _region(rows: Sequence[SizeRow], reference: float) -> str:
    if not any(row.moved for row in rows):
        return "A"
    gains = [gain for row in rows for gain in (row.spread("gain").low, row.spread("gain").high)]
    together = all(row.moved == row.count for row in rows)
    consistent = together and all(abs(gain / reference - 1.0) <= _CONSISTENT for gain in gains)
    return "C" if consistent else "B"
