"""By how much the fit changes each unknown for a derivative, and the sets in which one of them is changed. Pure.

The unknowns are the parameters θ, and then two for each slip: its place of rest, and the change of its friction.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from positioner.commissioning.observed import (
    COULOMB,
    COUNT,
    DEAD,
    FILL,
    PRELOAD,
    SPRING,
    STATIC,
    STRIBECK,
    VENT,
    VISCOUS,
)
from positioner.commissioning.release import RAMP_MA_PER_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.commissioning.observed import Observed

    Array = NDArray[np.float64]

RELATIVE = (SPRING, STATIC, COULOMB, VISCOUS, STRIBECK)
"""Of these the relative change is the unknown."""
_CHANGES = {COULOMB: 1e-3, VISCOUS: 1e-2, STRIBECK: 1e-2}
_LEAST_PERIODS = 0.5
"""The least change of a force: the ramp of so many periods. A command acts for a whole period, so that a slip without
lag begins at the beginning of one; the cost is rough over less."""
_CHANGE_SIGMA = 0.5
"""Beyond that the derivatives are taken over this part of the σ that a quantity would have if all others were known."""
_MOST_CHANGE = 0.03


def least_changes(theta: Array, observed: Sequence[Observed], gain: float) -> Array:
    """Return the least changes of all unknowns for a derivative; gain: B in N/mA."""
    period_s = min(each.slips.period_s for each in observed)
    force_n = _LEAST_PERIODS * gain * RAMP_MA_PER_S * period_s
    place_m = float(np.median(observed[-1].rest_m))
    changes = np.empty(COUNT)
    for number, change in _CHANGES.items():
        changes[number] = change
    changes[[SPRING, STATIC]] = force_n / (theta[SPRING] * abs(place_m) + force_n), force_n / theta[STATIC]
    changes[PRELOAD] = force_n
    for number in (FILL, VENT, DEAD):
        changes[number] = max(1e-3 * theta[number], 0.1 * min(period_s, 1e-3))
    own = [force_n / theta[SPRING], force_n / theta[STATIC]]
    return np.asarray(np.r_[changes, np.tile(own, sum(len(each.rest_m) for each in observed))])


def changes_at(curvature: Array, theta: Array, least: Array) -> Array:
    """Return the changes for the next derivatives, from the curvature of half the cost along each unknown."""
    changes: Array = _CHANGE_SIGMA / np.sqrt(np.maximum(curvature, 1e-18))
    relative = [*RELATIVE, *range(COUNT + 1, len(changes), 2)]
    changes[relative] = np.minimum(changes[relative], _MOST_CHANGE)
    changes[PRELOAD] = min(changes[PRELOAD], _MOST_CHANGE * float(theta[STATIC]))
    return np.maximum(changes, least)


def variants(theta: Array, own: Array, changes: Array, own_changes: Array) -> tuple[Array, Array]:
    """Return θ and own unknowns, (2, slip), with one of them changed in each set but the first."""
    thetas = np.tile(theta, (COUNT + 3, 1))
    owns = np.tile(own, (COUNT + 3, 1, 1))
    for number in range(COUNT):
        thetas[number + 1, number] += changes[number] * (theta[number] if number in RELATIVE else 1.0)
    for number in range(2):
        owns[COUNT + 1 + number, number] += own_changes[number]
    return thetas, owns
