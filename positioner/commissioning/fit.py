"""The fit: spring, friction, lag and dead time from the strokes, breakaways and steps of an experiment. Pure.

Least squares over all readings of all slips at once, by Gauss-Newton with Levenberg's damping. Every slip also has two
unknowns of its own: where it began, and by how much its friction differs from the mean. Their spread is a part of the
intervals, so that friction that varies from place to place makes them wider.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from positioner.commissioning.derivatives import RELATIVE, changes_at, least_changes, variants
from positioner.commissioning.observed import (
    COULOMB,
    COUNT,
    DEAD,
    FILL,
    STATIC,
    VENT,
    residuals,
    sets_of,
)
from positioner.commissioning.slips import play

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from positioner.commissioning.observed import Observed

    Array = NDArray[np.float64]

_PASSES = 24
_DONE = 0.05
"""A twentieth of what one σ costs."""
_DAMPINGS = (0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 3.0)
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
    done: float = _DONE,
    tell: Callable[[float], object] = lambda _part: None,
) -> Fitted:
    """Return the parameters that explain the readings best, from `start` or the values of `prior`.

    gain: B in N/mA; friction_sigma: the expected scatter of the friction between slips, as a part of it.
    start: θ and the own unknowns of the slips; done: it ends where a pass gains less of the cost.
    tell: receives after each pass the part of all passes that it may take.
    """
    theta = prior.theta.copy() if start is None else start[0].copy()
    own = tuple(start[1]) if start else tuple(np.zeros((2, len(each.rest_m))) for each in observed)
    changes = least = least_changes(theta, observed, gain)
    known = _normal(observed, mass_kg, gain, prior, theta, own, friction_sigma, changes)
    for number in range(_PASSES):
        tell(number / _PASSES)
        trials = []
        for damping in _DAMPINGS:
            change = _step(known, theta, damping)
            trials.append(_moved(theta, own, change, observed))
        costs = _costs(observed, mass_kg, gain, prior, [trial[0] for trial in trials], trials, friction_sigma)
        best = int(np.nanargmin(costs))
        if not costs[best] < known.cost:
            break
        gained = known.cost - costs[best]
        theta, own = trials[best]
        changes = changes_at(np.diag(known.matrix), theta, least)
        known = _normal(observed, mass_kg, gain, prior, theta, own, friction_sigma, changes)
        if gained < done:
            break
    inverse = _inverse(known.matrix)
    return Fitted(theta, inverse[:COUNT, :COUNT], known.cost, _scatter(own, inverse, friction_sigma), own)


def positions_of(observed: Sequence[Observed], mass_kg: float, gain: float, fitted: Fitted) -> list[Array]:
    """Return the positions in m that a fit gives each of `observed`, as arrays of (reading, slip)."""
    theta = fitted.theta[None, :]
    return [
        play(each.slips, sets_of(theta, own[None], each, mass_kg, gain))[:, 0, :]
        for each, own in zip(observed, fitted.own, strict=True)
    ]


@dataclass(frozen=True, slots=True)
class _Normal:
    matrix: Array
    vector: Array
    cost: float


def _solved(matrix: Array, vector: Array) -> Array:
    """Return the solution of the normal equations, scaled as in `_inverse`; the shortest where they are singular."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    try:
        return np.asarray(np.linalg.solve(matrix * scale * scale[:, None], vector * scale) * scale)
    except np.linalg.LinAlgError:
        return np.asarray(_inverse(matrix) @ vector)


def _inverse(matrix: Array) -> Array:
    """Return the inverse, scaled before: newtons and seconds side by side would hide the weakest direction."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    return np.asarray(np.linalg.pinv(matrix * scale * scale[:, None]) * scale * scale[:, None])


def _scatter(own: Sequence[Array], inverse: Array, before: float) -> float:
    """Return the scatter of the friction between slips: that of the estimates, and what they leave open."""
    estimates = np.concatenate([each[1] for each in own])
    numbers = COUNT + 2 * np.arange(len(estimates)) + 1
    left = np.minimum(inverse[numbers, numbers], before * before)
    return float(np.sqrt(np.mean(estimates * estimates + left)))


def _normal(
    observed: Sequence[Observed],
    mass_kg: float,
    gain: float,
    prior: Prior,
    theta: Array,
    own: Sequence[Array],
    friction_sigma: float,
    changes: Array,
) -> _Normal:
    """Return the normal equations at θ; the unknowns of the slips follow the parameters, two for each slip."""
    total = len(changes)
    matrix, vector, cost, first = np.zeros((total, total)), np.zeros(total), 0.0, COUNT
    for each, mine in zip(observed, own, strict=True):
        own_changes = changes[first : first + mine.size].reshape(-1, 2).T
        thetas, owns = variants(theta, mine, changes, own_changes)
        found = residuals(each, play(each.slips, sets_of(thetas, owns, each, mass_kg, gain)))
        base = found[:, 0, :]
        slopes = found[:, 1:, :] - base[:, None, :]
        slopes[:, :COUNT] /= changes[:COUNT, None]
        slopes[:, COUNT:] /= own_changes
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
    for number in RELATIVE:
        off[number] = np.log(theta[number] / prior.theta[number])
    return off


def _step(known: _Normal, theta: Array, damping: float) -> Array:
    """Return the damped step to the least cost in which no time becomes negative."""
    matrix = known.matrix + damping * np.diag(np.diag(known.matrix))
    change, free = np.zeros(len(known.vector)), np.ones(len(known.vector), dtype=bool)
    while True:
        wanted = known.vector[free] - matrix[np.ix_(free, ~free)] @ change[~free]
        change[free] = _solved(matrix[np.ix_(free, free)], wanted)
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
        if number in RELATIVE:
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
