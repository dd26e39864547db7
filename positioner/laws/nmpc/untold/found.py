"""The actuator that the evidence points to: between the candidates. Pure."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.valve.actuator import ActuatorParameters

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged_settings import LaggedSettings
    from positioner.laws.nmpc.untold.watch import Watch

_SHORT_S, _TOLERANCE_OF_NOISE = 0.003, 0.08
"""Up to this lag; and the tolerance, as a part of σ of a reading."""
_FARTHEST = 0.5
"""How far the maximum may be from the best candidate, as a part of the way to the next one."""


def settings_for(own: LaggedSettings, actuator: ActuatorParameters) -> LaggedSettings:
    """Return the settings of the law for this actuator: after a short lag a correction takes milliseconds.

    So smaller errors are worth one: most of the time goes into the average that shows them.
    """
    lag_s = max(actuator.fill_time_constant_s, actuator.vent_time_constant_s)
    if lag_s > _SHORT_S:
        return own
    return replace(own, tolerance_of_noise=min(own.tolerance_of_noise, _TOLERANCE_OF_NOISE))


def actuator_of(watch: Watch, period_s: float) -> ActuatorParameters:
    """Return the actuator with the most evidence: at the top of a parabola over the logarithm of the lag."""
    minds = watch.minds
    best = 0
    for index in range(len(minds)):
        if minds[index].evidence > minds[best].evidence:
            best = index
    candidate = minds[best].candidate
    if candidate.lag_s == 0.0:
        return ActuatorParameters(dead_time_s=candidate.late * period_s)
    lag_s = candidate.lag_s
    if 0 < best < len(minds) - 1 and minds[best - 1].candidate.lag_s > 0.0:
        below, above = minds[best - 1], minds[best + 1]
        left, right = best_less(minds[best].evidence, below.evidence), best_less(minds[best].evidence, above.evidence)
        # as if the three were equally far apart
        shift = min(max(0.5 * (left - right) / (left + right), -_FARTHEST), _FARTHEST)
        other_s = above.candidate.lag_s if shift > 0.0 else below.candidate.lag_s
        lag_s *= math.exp(abs(shift) * math.log(other_s / lag_s))
    return ActuatorParameters(fill_time_constant_s=lag_s, vent_time_constant_s=lag_s)


def best_less(best: float, other: float) -> float:
    """Return how much less evidence another candidate has than the best one, and not 0."""
    return max(best - other, _LEAST_DIFFERENCE)


_LEAST_DIFFERENCE = 1e-3
