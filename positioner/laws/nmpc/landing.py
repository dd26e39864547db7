"""The landing bias: by how much moves end beside their aim again and again, by place and direction. Pure.

From every landing the filter corrects spring and friction. An error that repeats itself nevertheless is a property of
the valve that the model does not have, and the stiction table keeps it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass
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
    """A move from its origin to its aim, in m, and its direction (±1)."""

    origin_m: float
    aim_m: float
    direction: float

    def is_planned(self, stop: Resting) -> bool:
        """Whether the stem has stopped at the aim, as far as the model knows.

        Otherwise the filter has foreseen another place: the push came late, or was too weak. Such a stop corrects the
        load, and teaches no bias.
        """
        return abs(stop.x - self.aim_m) <= _SIGNIFICANT * stop.sigma_m

    def samples(self, stem: Resting) -> tuple[LearnedSample, ...]:
        """Return the bias in m of a landing that has certainly happened, once the position of the stem is known.

        A move whose error is larger than its distance teaches nothing: either the stem ended short of the origin, or
        as far beyond the aim, and the law plans neither.
        """
        bias_m = stem.x - self.aim_m
        if abs(bias_m) > abs(self.aim_m - self.origin_m) + _SIGNIFICANT * stem.sigma_m:
            return ()
        return (LearnedSample(Quantity.LANDING_BIAS, self.aim_m, direction_of(self.direction), bias_m),)


def landing_bias_m(table: StictionTable, setpoint_m: float, direction: float) -> float:
    """Return the bias in m of moves in `direction` (±1) to `setpoint_m`, 0 where the table has no significant one."""
    cell = table.cell(Quantity.LANDING_BIAS, setpoint_m, direction_of(direction))
    if cell is None or len(cell.samples) < _LEAST_SAMPLES or table.age(cell) > _LARGEST_AGE:
        return 0.0
    error_m = cell.spread / math.sqrt(len(cell.samples) - 1)
    return cell.mean if abs(cell.mean) > _SIGNIFICANT * error_m else 0.0
