"""The static friction at each breakaway from rest, by the model's slip that is nearest to the readings. Pure."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from positioner.commissioning.noise import noise_of
from positioner.commissioning.observed import residuals, sets_of, theta_of
from positioner.commissioning.record import Kind
from positioner.commissioning.slips import play
from positioner.commissioning.windows import releases

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.commissioning.procedure import ProcedureLimits
    from positioner.commissioning.record import Stretch
    from positioner.valve.parameters import ValveParameters

_RANGE = (0.3, 3.0)
"""The static friction is sought between these parts of the configured one."""
_TRIED, _ROUNDS = 15, 4


@dataclass(frozen=True, slots=True)
class Breakaway:
    """Static friction in N at a place in m, against a force in `direction` (±1)."""

    position_m: float
    direction: float
    static_n: float


def breakaways_of(
    stretches: Sequence[Stretch], limits: ProcedureLimits, valve: ValveParameters, period_s: float
) -> tuple[Breakaway, ...]:
    """Return the static friction at each breakaway: the one with which the model's slip is nearest to the readings.

    The stem slides for some milliseconds before it is seen to, and one with strong damping creeps for longer.
    """
    observed = releases(stretches, Kind.BREAKAWAY, noise_of(stretches), limits, period_s)
    if observed is None:
        return ()
    slips = observed.slips
    count = len(slips.direction)
    weight = observed.weight.copy()
    weight[:, slips.seen + 1 :] = 0.0  # the current that then catches the stem hides the static friction
    observed = replace(observed, weight=weight)
    low_n, high_n = (np.full(count, part * valve.static_friction_n) for part in _RANGE)
    best_n = 0.5 * (low_n + high_n)
    theta, own = np.tile(theta_of(valve), (_TRIED, 1)), np.zeros((_TRIED, 2, count))
    for _ in range(_ROUNDS):
        tried_n = np.linspace(low_n, high_n, _TRIED)
        sets = replace(sets_of(theta, own, observed, valve.mass_kg, valve.force_gain_n_per_ma), static_n=tried_n)
        positions_m = play(slips, sets)
        left = residuals(observed, positions_m)
        costs = np.sum(left * left, axis=0)
        at = np.argmin(costs, axis=0)
        best_n = tried_n[at, np.arange(count)]
        step_n = (high_n - low_n) / (_TRIED - 1)
        low_n, high_n = np.maximum(best_n - step_n, valve.coulomb_friction_n), best_n + step_n
    return tuple(
        Breakaway(float(x), float(s), float(f))
        for x, s, f in zip(observed.rest_m, slips.direction, best_n, strict=True)
    )
