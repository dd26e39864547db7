"""Where moves come to rest beside where they were aimed, by place and direction: what no state of the filter explains.

Pure. The filter learns from every landing what it can put down to spring and friction. What repeats itself all the same
is the plant's own, and the table keeps it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.valve.stiction import LearnedSample, Quantity, direction_of

if TYPE_CHECKING:
    from positioner.laws.nmpc.filter import Resting
    from positioner.valve.stiction import StictionTable

_LEAST_SAMPLES = 3
_LARGEST_AGE = 500
"""In learned samples."""
_SIGNIFICANT = 3.0
"""Standard errors that count."""


@dataclass(frozen=True, slots=True)
class Landing:
    """A move: where it began and where it was aimed in m, in which direction (±1)."""

    origin_m: float
    aim_m: float
    direction: float

    def is_planned(self, stop: Resting) -> bool:
        """Whether the model has stopped the stem where it was aimed, as far as the model can tell.

        A stop elsewhere is one that the filter has seen coming: the push came late, or was not enough. It corrects the
        load, and is no landing.
        """
        return abs(stop.x - self.aim_m) <= _SIGNIFICANT * stop.sigma_m

    def samples(self, stem: Resting) -> tuple[LearnedSample, ...]:
        """Return the bias in m of a landing that is sure to have happened, once it is known where the stem is.

        A move whose error is larger than its way tells of no landing: short of its origin it did not begin as planned,
        and as far beyond its aim it is one that the law does not plan.
        """
        bias_m = stem.x - self.aim_m
        if abs(bias_m) > abs(self.aim_m - self.origin_m) + _SIGNIFICANT * stem.sigma_m:
            return ()
        return (LearnedSample(Quantity.LANDING_BIAS, self.aim_m, direction_of(self.direction), bias_m),)


def landing_bias_m(table: StictionTable, setpoint_m: float, direction: float) -> float:
    """Return by how much moves in `direction` (±1) to `setpoint_m` land beside it, in m; 0 while that is in doubt."""
    cell = table.cell(Quantity.LANDING_BIAS, setpoint_m, direction_of(direction))
    if cell is None or len(cell.samples) < _LEAST_SAMPLES or table.age(cell) > _LARGEST_AGE:
        return 0.0
    error_m = cell.spread / math.sqrt(len(cell.samples) - 1)
    return cell.mean if abs(cell.mean) > _SIGNIFICANT * error_m else 0.0
