"""The fit: spring, friction, lag and dead time from the strokes, breakaways and steps of an experiment. Pure.

Least squares over all readings of all slips at once, by Gauss-Newton with Levenberg's damping. Every slip also has two
unknowns of its own: where it began, and by how much its friction differs from the mean. Their spread is a part of the
intervals, so that friction that varies from place to place makes them wider.

Several fits of the same readings, from several beginnings, are made side by side (`fits`): their slips are played in
one call, since numpy's calls on some seventy numbers cost more than the numbers. Each fit asks for what it needs.
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
from positioner.commissioning.slips import play, substeps_of

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence

    from numpy.typing import NDArray

    from positioner.commissioning.observed import Observed

    Array = NDArray[np.float64]
    Asked = list[tuple[Array, Array]]
    """Sets whose residuals are needed: for each of the observed θ as (set, parameter), own as (set, 2, slip)."""

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


@dataclass(frozen=True, slots=True)
class Beginning:
    """Where a fit begins: what is known before, θ, and the own unknowns of the slips, (2, slip) for each observed."""

    prior: Prior
    theta: Array
    own: tuple[Array, ...]


def fits(
    observed: Sequence[Observed],
    mass_kg: float,
    gain: float,
    begins: Sequence[Beginning],
    friction_sigma: float,
    done: float = _DONE,
    tell: Callable[[float], object] = lambda _part: None,
) -> list[Fitted]:
    """Return for each beginning the parameters that explain the readings best; the fits are made side by side.

    Args:
        observed: strokes, breakaways and steps.
        mass_kg: of the stem.
        gain: B in N/mA.
        begins: where the fits begin.
        friction_sigma: the expected scatter of the friction between slips, as a part of it.
        done: a fit ends where a pass gains less of its cost.
        tell: receives before each half of a pass the part of all passes that are made at most.
    """
    running = {number: _fitting(observed, gain, begin, friction_sigma, done) for number, begin in enumerate(begins)}
    asked = {number: next(each) for number, each in running.items()}
    found: dict[int, Fitted] = {}
    rounds = 0
    while asked:
        tell(min(rounds / (2 * _PASSES), 1.0))
        rounds += 1
        answers = _played(observed, mass_kg, gain, asked)
        for number, answer in answers.items():
            try:
                asked[number] = running[number].send(answer)
            except StopIteration as end:
                found[number] = end.value
                del asked[number]
    return [found[number] for number in range(len(begins))]


def _played(
    observed: Sequence[Observed], mass_kg: float, gain: float, asked: dict[int, Asked]
) -> dict[int, list[Array]]:
    """Return the residuals, (sample, set, slip) for each of the observed, that each fit asks for.

    Sets of fits that are integrated alike are played in one call; what they are played beside changes no bit of them.
    """
    answers: dict[int, list[Array]] = {number: [] for number in asked}
    for place, each in enumerate(observed):
        alike: dict[int, list[int]] = {}
        for number, sets in asked.items():
            within = substeps_of(each.slips, sets_of(*sets[place], each, mass_kg, gain))
            alike.setdefault(within, []).append(number)
        for numbers in alike.values():
            thetas, owns = (np.concatenate([asked[number][place][part] for number in numbers]) for part in (0, 1))
            found = residuals(each, play(each.slips, sets_of(thetas, owns, each, mass_kg, gain)))
            first = 0
            for number in numbers:
                count = len(asked[number][place][0])
                answers[number].append(np.ascontiguousarray(found[:, first : first + count]))
                first += count
    return answers


def _fitting(
    observed: Sequence[Observed], gain: float, begin: Beginning, friction_sigma: float, done: float
) -> Generator[Asked, list[Array], Fitted]:
    """Make one fit: yield the sets whose residuals it needs next, receive these, and return what was found."""
    prior, theta, own = begin.prior, begin.theta, begin.own
    changes = least = least_changes(theta, observed, gain)
    answer = yield _changed(theta, own, changes)
    known = _normal(observed, answer, prior, theta, own, friction_sigma, changes)
    for _ in range(_PASSES):
        trials = [_moved(theta, own, _step(known, theta, damping), observed) for damping in _DAMPINGS]
        thetas = np.stack([trial[0] for trial in trials])
        owns = [np.stack([trial[1][number] for trial in trials]) for number in range(len(observed))]
        answer = yield [(thetas, each) for each in owns]
        costs = _costs(observed, answer, prior, thetas, owns, friction_sigma)
        best = int(np.nanargmin(costs))
        if not costs[best] < known.cost:
            break
        gained = known.cost - costs[best]
        theta, own = trials[best]
        changes = changes_at(np.diag(known.matrix), theta, least)
        answer = yield _changed(theta, own, changes)
        known = _normal(observed, answer, prior, theta, own, friction_sigma, changes)
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


def _changed(theta: Array, own: Sequence[Array], changes: Array) -> Asked:
    """Return θ, and θ with one unknown changed in each set; the unknowns of the slips follow the parameters."""
    asked, first = [], COUNT
    for mine in own:
        asked.append(variants(theta, mine, changes, changes[first : first + mine.size].reshape(-1, 2).T))
        first += mine.size
    return asked


def _normal(
    observed: Sequence[Observed],
    answer: Sequence[Array],
    prior: Prior,
    theta: Array,
    own: Sequence[Array],
    friction_sigma: float,
    changes: Array,
) -> _Normal:
    """Return the normal equations at θ, from the residuals of `_changed`; two unknowns for each slip follow θ."""
    total = len(changes)
    matrix, vector, cost, first = np.zeros((total, total)), np.zeros(total), 0.0, COUNT
    for each, mine, found in zip(observed, own, answer, strict=True):
        own_changes = changes[first : first + mine.size].reshape(-1, 2).T
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
    answer: Sequence[Array],
    prior: Prior,
    thetas: Array,
    owns: Sequence[Array],
    friction_sigma: float,
) -> Array:
    """Return the cost of each trial, from its residuals."""
    costs = np.array([float(np.sum((_off(theta, prior) / prior.sigma) ** 2)) for theta in thetas])
    for each, own, found in zip(observed, owns, answer, strict=True):
        costs += np.sum(found * found, axis=(0, 2))
        costs += np.sum((own[:, 0] / each.rest_sigma_m) ** 2 + (own[:, 1] / friction_sigma) ** 2, axis=1)
    return costs
