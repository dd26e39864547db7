"""Where moves come to rest beside where they were aimed, by place and direction: what no state of the filter explains.

Pure. The filter learns from every landing what it can put down to spring and friction. What repeats itself all the same
is the plant's own, and the table keeps it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.stiction import LearnedSample, Quantity, direction_of

if TYPE_CHECKING:
    from positioner.adaptive_estimate import Resting
    from positioner.stiction import StictionTable

_LEAST_SAMPLES = 3
_LARGEST_AGE = 500
"""In learned samples."""
_SIGNIFICANT = 3.0
"""Standard errors that a mean must be away from 0."""


@dataclass(frozen=True, slots=True)
class Landing:
    """A move that is over: where it was aimed in m, in which direction (±1)."""

    aim_m: float
    direction: float

    def sample(self, stem: Resting) -> LearnedSample:
        """Return the landing's bias in m, once it is known where the stem is."""
        return LearnedSample(Quantity.LANDING_BIAS, self.aim_m, direction_of(self.direction), stem.x - self.aim_m)


def landing_bias_m(table: StictionTable, setpoint_m: float, direction: float) -> float:
    """Return by how much moves in `direction` (±1) to `setpoint_m` land beside it, in m; 0 while that is in doubt."""
    cell = table.cell(Quantity.LANDING_BIAS, setpoint_m, direction_of(direction))
    if cell is None or len(cell.samples) < _LEAST_SAMPLES or table.age(cell) > _LARGEST_AGE:
        return 0.0
    error_m = cell.spread / math.sqrt(len(cell.samples) - 1)
    return cell.mean if abs(cell.mean) > _SIGNIFICANT * error_m else 0.0
