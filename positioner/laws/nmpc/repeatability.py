"""How well landings repeat: the noise of a motion, as a part of the configured one, learned from landings. Pure.

The model predicts where a move ends, with the variance P. The readings of the rest that follows show where it ended,
with the variance R. Their difference ν has the variance P + R, if the noise of the motion (friction that changes,
unknown forces, the landing itself) is as large as configured. A valve whose friction is the same in each move lands
nearer than that, again and again. Then one landing is worth more than hundreds of readings of a noisy sensor.

So the variance of this noise has a factor of at most 1: the mean of four factors by their likelihood log N(ν; 0, P + R)
over all landings, where P is proportional to the factor. A landing counts less with every later one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.laws.nmpc.filter import Resting

_FACTORS = (1.0, 0.25, 0.0625, 0.015625)
_BEFORE = (0.0, 1.0, 2.0, 2.0)
"""Log probability of each factor before any landing: a valve that does not repeat itself soon shows it."""
_KEPT = 0.95
"""The weight of all landings before another one."""
_LEAST = -6.0
"""No factor is less probable than this, as a log, relative to the likeliest one: a valve may change."""
_OUTLIER = 9.0
"""A larger ν²/(P + R) counts as this one."""


@dataclass(frozen=True, slots=True)
class Repeatability:
    """The log likelihood of each factor, and the mean factor by their probabilities."""

    logs: tuple[float, ...] = _BEFORE
    factor: float = 0.1

    def followed_by(self, rest: Resting) -> Repeatability:
        """Return the repeatability after a rest that began with a landing, at its end."""
        predicted_m2 = rest.anchor.covariance.xx
        used_m2 = predicted_m2 - rest.variance_m2
        if used_m2 <= 0.0 or rest.anchor.unforeseen == 0.0:
            return self
        # the average is the prediction, moved by P/(P + R) of the difference
        readings_m2 = predicted_m2 * rest.variance_m2 / used_m2
        difference_m = (rest.x - rest.anchor.x) * predicted_m2 / used_m2
        logs, highest = list[float](), -math.inf
        for index in range(len(_FACTORS)):
            variance_m2 = predicted_m2 * _FACTORS[index] / rest.anchor.unforeseen + readings_m2
            squares = min(difference_m * difference_m / variance_m2, _OUTLIER)
            log = _KEPT * self.logs[index] + (1.0 - _KEPT) * _BEFORE[index] - 0.5 * (squares + math.log(variance_m2))
            logs.append(log)
            highest = max(highest, log)
        total, mean = 0.0, 0.0
        for index in range(len(_FACTORS)):
            logs[index] = max(logs[index] - highest, _LEAST)
            weight = math.exp(logs[index])
            total += weight
            mean += weight * _FACTORS[index]
        return Repeatability(tuple(logs), mean / total)
