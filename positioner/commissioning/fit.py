"""The fit: spring, friction, lag and dead time from the strokes, breakaways and steps of an experiment. Pure.

Least squares over all readings of all slips at once, by Gauss-Newton with Levenberg's damping. Every slip also has two
unknowns of its own: where it began, and by how much its friction differs from the mean. Their spread is a part of the
intervals, so that friction that varies from place to place makes them wider.
"""

from __future__ import annotations

from dataclasses import dataclass
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
    residuals,
    sets_of,
)
from positioner.commissioning.slips import play

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.commissioning.observed import Observed

    Array = NDArray[np.float64]

_RELATIVE = (SPRING, STATIC, COULOMB, VISCOUS, STRIBECK)
_PASSES = 14
_DONE = 1e-4
_DAMPINGS = (0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 3.0)
_CHANGE = 3e-5
"""Of a force, for its derivative: a slow ramp then slips a fraction of a millisecond later."""
_CHANGES = {SPRING: _CHANGE, STATIC: _CHANGE, COULOMB: 1e-3, VISCOUS: 1e-2, STRIBECK: 1e-2}
_LEAST_DIFFERENCE = 0.02
"""F_s exceeds F_c by at least this part."""


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known before: the values θ in the order of `observed`, and σ of each (relative for K, F and V_s)."""

    theta: Array
    sigma: Array


@dataclass(frozen=True, slots=True)
class Fitted:
    """The parameters θ, their covariance (relative for K, F and V_s), the cost, and the scatter of the friction."""

    theta: Array
    covariance: Array
    cost: float
    friction_sigma: float
    own: tuple[Array, ...]


def fit(
    observed: Sequence[Observed],
    mass_kg: float,
    gain: float,
    prior: Prior,
    friction_sigma: float,
    start: tuple[Array, Sequence[Array]] | None = None,
) -> Fitted:
    """Return the parameters that explain the readings best, from `start` or the values of `prior`.

    gain: B in N/mA; friction_sigma: the expected scatter of the friction between slips, as a part of it.
    start: θ and the own unknowns of the slips.
    """
    theta = prior.theta.copy() if start is None else start[0].copy()
    own = tuple(start[1]) if start else tuple(np.zeros((2, len(each.rest_m))) for each in observed)
    known = _normal(observed, mass_kg, gain, prior, theta, own, friction_sigma)
    for _ in range(_PASSES):
        trials = []
        for damping in _DAMPINGS:
            change = _step(known, theta, damping)
            trials.append(_moved(theta, own, change, observed))
        costs = _costs(observed, mass_kg, gain, prior, [trial[0] for trial in trials], trials, friction_sigma)
        best = int(np.argmin(costs))
        if not costs[best] < known.cost:
            break
        gained = known.cost - costs[best]
        theta, own = trials[best]
        known = _normal(observed, mass_kg, gain, prior, theta, own, friction_sigma)
        if gained < _DONE * known.cost and gained < 0.5:  # noqa: PLR2004 - half a log-likelihood
            break
    inverse: Array = np.linalg.pinv(known.matrix).astype(np.float64)
    return Fitted(theta, inverse[:COUNT, :COUNT], known.cost, _scatter(own, inverse, friction_sigma), own)


@dataclass(frozen=True, slots=True)
class _Normal:
    matrix: Array
    vector: Array
    cost: float


def _scatter(own: Sequence[Array], inverse: Array, before: float) -> float:
    """Return the scatter of the friction between slips: that of the estimates, and what they leave open."""
    estimates = np.concatenate([each[1] for each in own])
    numbers = COUNT + 2 * np.arange(len(estimates)) + 1
    left = np.minimum(inverse[numbers, numbers], before * before)
    return float(np.sqrt(np.mean(estimates * estimates + left)))


def _variants(theta: Array, own: Array, period_s: float) -> tuple[Array, Array, Array]:
    """Return θ and own unknowns with one of them changed in each set, and the changes."""
    change = np.empty(COUNT + 2)
    for number in range(COUNT):
        if number in _RELATIVE:
            change[number] = _CHANGES[number]
        elif number == PRELOAD:
            change[number] = _CHANGE * theta[STATIC]
        else:
            change[number] = max(1e-3 * theta[number], 0.1 * min(period_s, 1e-3))
    change[COUNT], change[COUNT + 1] = 1e-6, _CHANGE
    thetas = np.tile(theta, (COUNT + 3, 1))
    owns = np.tile(own, (COUNT + 3, 1, 1))
    for number in range(COUNT):
        thetas[number + 1, number] += change[number] * (theta[number] if number in _RELATIVE else 1.0)
    owns[COUNT + 1, 0] += change[COUNT]
    owns[COUNT + 2, 1] += change[COUNT + 1]
    return thetas, owns, change


def _normal(
    observed: Sequence[Observed],
    mass_kg: float,
    gain: float,
    prior: Prior,
    theta: Array,
    own: Sequence[Array],
    friction_sigma: float,
) -> _Normal:
    """Return the normal equations at θ; the unknowns of the slips follow the parameters, two for each slip."""
    total = COUNT + 2 * sum(len(each.rest_m) for each in observed)
    matrix, vector, cost, first = np.zeros((total, total)), np.zeros(total), 0.0, COUNT
    for each, mine in zip(observed, own, strict=True):
        thetas, owns, change = _variants(theta, mine, each.slips.period_s)
        found = residuals(each, play(each.slips, sets_of(thetas, owns, each, mass_kg, gain)))
        base = found[:, 0, :]
        slopes = (found[:, 1:, :] - base[:, None, :]) / change[None, :, None]
        cost += float(np.sum(base * base))
        for slip in range(base.shape[1]):
            numbers = np.r_[np.arange(COUNT), first, first + 1]
            columns = slopes[:, :, slip]
            matrix[np.ix_(numbers, numbers)] += columns.T @ columns
            vector[numbers] -= columns.T @ base[:, slip]
            for number, value, sigma in (
                (first, mine[0, slip], each.rest_sigma_m[slip]),
                (first + 1, mine[1, slip], friction_sigma),
            ):
                matrix[number, number] += 1.0 / (sigma * sigma)
                vector[number] -= value / (sigma * sigma)
                cost += (value / sigma) ** 2
            first += 2
    off = _off(theta, prior)
    matrix[range(COUNT), range(COUNT)] += 1.0 / (prior.sigma * prior.sigma)
    vector[:COUNT] -= off / (prior.sigma * prior.sigma)
    return _Normal(matrix, vector, cost + float(np.sum((off / prior.sigma) ** 2)))


def _off(theta: Array, prior: Prior) -> Array:
    off = theta - prior.theta
    for number in _RELATIVE:
        off[number] = np.log(theta[number] / prior.theta[number])
    return off


def _step(known: _Normal, theta: Array, damping: float) -> Array:
    """Return the damped step to the least cost in which no time becomes negative."""
    matrix = known.matrix + damping * np.diag(np.diag(known.matrix))
    change, free = np.zeros(len(known.vector)), np.ones(len(known.vector), dtype=bool)
    while True:
        wanted = known.vector[free] - matrix[np.ix_(free, ~free)] @ change[~free]
        change[free] = np.linalg.lstsq(matrix[np.ix_(free, free)], wanted, rcond=None)[0]
        beyond = [number for number in (FILL, VENT, DEAD) if free[number] and change[number] < -theta[number]]
        if not beyond:
            return change
        free[beyond] = False
        change[beyond] = -theta[beyond]


def _moved(
    theta: Array, own: Sequence[Array], change: Array, observed: Sequence[Observed]
) -> tuple[Array, tuple[Array, ...]]:
    """Return θ and the slips' own unknowns after a step, inside what a valve can be."""
    after = theta.copy()
    for number in range(COUNT):
        if number in _RELATIVE:
            after[number] *= float(np.exp(np.clip(change[number], -0.7, 0.7)))
        else:
            after[number] += change[number]
    after[[FILL, VENT, DEAD]] = np.maximum(after[[FILL, VENT, DEAD]], 0.0)
    after[COULOMB] = min(after[COULOMB], (1.0 - _LEAST_DIFFERENCE) * after[STATIC])
    first, moved = COUNT, []
    for each, mine in zip(observed, own, strict=True):
        count = len(each.rest_m)
        moved.append(mine + change[first : first + 2 * count].reshape(count, 2).T)
        first += 2 * count
    return after, tuple(moved)


def _costs(
    observed: Sequence[Observed],
    mass_kg: float,
    gain: float,
    prior: Prior,
    thetas: Sequence[Array],
    trials: Sequence[tuple[Array, tuple[Array, ...]]],
    friction_sigma: float,
) -> Array:
    """Return the cost of each trial."""
    costs = np.array([float(np.sum((_off(theta, prior) / prior.sigma) ** 2)) for theta in thetas])
    for number, each in enumerate(observed):
        own = np.stack([trial[1][number] for trial in trials])
        found = residuals(each, play(each.slips, sets_of(np.stack(thetas), own, each, mass_kg, gain)))
        costs += np.sum(found * found, axis=(0, 2))
        costs += np.sum((own[:, 0] / each.rest_sigma_m) ** 2 + (own[:, 1] / friction_sigma) ** 2, axis=1)
    return costs
