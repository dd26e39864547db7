"""The points of a campaign: a grid, a Latin hypercube or a Sobol sequence, the same from the same seed. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import qmc

from positioner.campaign.schema import DesignSettings, Kind, Scale

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.campaign.schema import RangeSettings, Value


@dataclass(frozen=True, slots=True)
class Parameter:
    """One dimension of a campaign.

    name: its name in the file. range: what the file says. whole: its values are whole numbers.
    keys: what it changes in the scenario, each with the value that is multiplied; None: the value itself is set.
    """

    name: str
    range: RangeSettings
    keys: tuple[tuple[str, float | None], ...]
    whole: bool = False

    def value_at(self, place: float) -> Value:
        """Return the value at a `place` from 0 (`low`, or the first value) to 1 (`high`, or the last one)."""
        limits = self.range
        if limits.values is not None:
            return limits.values[min(int(place * len(limits.values)), len(limits.values) - 1)]
        low, high = self.ends
        if self.whole:
            low, high = low - 0.5, high + 0.5  # every whole number has an equal part
        value = self._between(low, high, place)
        value = min(max(value, self.ends[0]), self.ends[1])
        return round(value) if self.whole else value

    def place_of(self, value: Value) -> float:
        """Return the place of a `value` from 0 to 1, the inverse of `value_at`; the middle of its part for a list."""
        limits = self.range
        if limits.values is not None:
            return (limits.values.index(value) + 0.5) / len(limits.values)
        low, high = self.ends
        if limits.scale is Scale.LOGARITHMIC:
            return math.log(float(value) / low) / math.log(high / low)
        return (float(value) - low) / (high - low)

    @property
    def ends(self) -> tuple[float, float]:
        """Low and high end of a range."""
        low, high = self.range.low, self.range.high
        return (math.nan, math.nan) if low is None or high is None else (low, high)

    @property
    def levels(self) -> tuple[Value, ...]:
        """The values of a grid."""
        if self.range.values is not None:
            return self.range.values
        count = self.range.levels or 0
        low, high = self.ends
        values = tuple(self._between(low, high, step / (count - 1)) for step in range(count))
        return tuple(dict.fromkeys(map(round, values))) if self.whole else values

    def _between(self, low: float, high: float, place: float) -> float:
        if place == 1.0:
            return high
        if self.range.scale is Scale.LOGARITHMIC:
            return low * math.pow(high / low, place)
        return low + place * (high - low)


def size(design: DesignSettings, parameters: Sequence[Parameter]) -> int:
    """Return how many points the design has."""
    if design.kind is Kind.GRID:
        return math.prod(len(parameter.levels) for parameter in parameters)
    return design.points or 0


def points(design: DesignSettings, parameters: Sequence[Parameter]) -> list[tuple[Value, ...]]:
    """Return the values of every parameter at every point, in a fixed order."""
    if design.kind is Kind.GRID:
        return list(product(*(parameter.levels for parameter in parameters)))
    places = unit_points(design, len(parameters))
    return [
        tuple(parameter.value_at(place) for parameter, place in zip(parameters, point, strict=True))
        for point in places.tolist()
    ]


def unit_points(design: DesignSettings, dimensions: int) -> NDArray[np.float64]:
    """Return the points of a Latin hypercube or a Sobol sequence in the unit cube, shape (points, dimensions)."""
    count = design.points or 0
    chance = np.random.default_rng(design.seed)
    if design.kind is Kind.SOBOL:
        return np.asarray(qmc.Sobol(dimensions, seed=chance).random_base2(count.bit_length() - 1))
    return np.asarray(qmc.LatinHypercube(dimensions, seed=chance).random(count))
