"""By how much the fit changes each unknown for a derivative, and the sets in which one of them is changed. Pure.

The unknowns are the parameters θ, and then two for each slip: its place of rest, and the change of its friction.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from positioner.commissioning.observed import COULOMB, COUNT, PRELOAD, SPRING, STATIC, STRIBECK, VISCOUS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.commissioning.observed import Observed

    Array = NDArray[np.float64]

RELATIVE = (SPRING, STATIC, COULOMB, VISCOUS, STRIBECK)
"""Of these the relative change is the unknown."""
_CHANGE = 3e-5
"""Of a force, for its first derivative: a slow ramp then slips a fraction of a millisecond later."""
_CHANGES = {SPRING: _CHANGE, STATIC: _CHANGE, COULOMB: 1e-3, VISCOUS: 1e-2, STRIBECK: 1e-2}
_CHANGE_SIGMA = 0.5
"""The later derivatives are taken over this part of the σ that a quantity would have if all others were known. Over
less, the roughness of the cost counts: the least change of force shifts the step in which a slip begins."""
_MOST_CHANGE = 0.03


def first_changes(theta: Array, observed: Sequence[Observed]) -> Array:
    """Return the changes of all unknowns for the first derivatives."""
    period_s = min(each.slips.period_s for each in observed)
    changes = np.empty(COUNT)
    for number in range(COUNT):
        if number in RELATIVE:
            changes[number] = _CHANGES[number]
        elif number == PRELOAD:
            changes[number] = _CHANGE * theta[STATIC]
        else:
            changes[number] = max(1e-3 * theta[number], 0.1 * min(period_s, 1e-3))
    slips = sum(len(each.rest_m) for each in observed)
    return np.asarray(np.r_[changes, np.tile([1e-6, _CHANGE], slips)])


def later_changes(curvature: Array, theta: Array) -> Array:
    """Return the changes for the next derivatives, from the curvature of half the cost along each unknown."""
    changes: Array = _CHANGE_SIGMA / np.sqrt(np.maximum(curvature, 1e-18))
    relative = [*RELATIVE, *range(COUNT + 1, len(changes), 2)]
    changes[relative] = np.minimum(changes[relative], _MOST_CHANGE)
    changes[PRELOAD] = min(changes[PRELOAD], _MOST_CHANGE * float(theta[STATIC]))
    return changes


def variants(theta: Array, own: Array, changes: Array, own_changes: Array) -> tuple[Array, Array]:
    """Return θ and own unknowns, (2, slip), with one of them changed in each set but the first."""
    thetas = np.tile(theta, (COUNT + 3, 1))
    owns = np.tile(own, (COUNT + 3, 1, 1))
    for number in range(COUNT):
        thetas[number + 1, number] += changes[number] * (theta[number] if number in RELATIVE else 1.0)
    for number in range(2):
        owns[COUNT + 1 + number, number] += own_changes[number]
    return thetas, owns
