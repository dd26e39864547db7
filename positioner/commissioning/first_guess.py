"""A first guess for the fit: near enough that least squares finds the rest. Pure.

1. The strokes show spring, sliding friction, and the sum by which position lags behind current: τ + T_d + F_v/K.
2. At the static friction that lets the slow ramps slip when they did, the breakaways begin where they were seen.
3. Of all ways to divide that sum, the one that explains the steps best is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from positioner.commissioning.fit import Beginning, Prior, fits
from positioner.commissioning.observed import (
    COULOMB,
    DEAD,
    FILL,
    PRELOAD,
    SPRING,
    STATIC,
    STRIBECK,
    VENT,
    VISCOUS,
    excess,
    residuals,
    sets_of,
    weakened,
)
from positioner.commissioning.slips import play

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from positioner.commissioning.observed import Observed

    Array = NDArray[np.float64]

_FIXED = 1e-6
_TRIES = 81
_WIDTHS = (0.4, 0.05, 0.008, 0.0015)
_ROUNDS = 2
_SCATTER = 5e-4
_DONE = 0.5
_SLOW = 2.5
_FACTORS = (0.4, 0.8, 1.6)
_OFF_SIGMAS = np.linspace(-2.0, 2.0, 5)
_ALIGNED_PART, _DIVIDED_PART = 0.2, 0.4
"""Of the time of a first guess, at these places of it."""
_BLOCK = 50
"""Readings of a stroke, a quarter of a second, beyond which they say something new."""


def first_guess(
    strokes: Observed,
    breakaways: Observed,
    steps: Observed,
    mass_kg: float,
    gain: float,
    prior: Prior,
    ramp: float,
    tell: Callable[[float], object],
) -> tuple[Array, Array]:
    """Return θ, and the own unknowns of the breakaways.

    ramp: that of the breakaways in mA/s; tell: receives the part that is done.
    """
    theta = prior.theta.copy()
    theta[DEAD] = 0.0
    own = np.zeros((2, len(breakaways.rest_m)))
    for widths in (_WIDTHS, ()):  # the lines once more with the static friction
        theta, sums_s, sigma_s, wrong = _lines(strokes, gain, theta)
        theta[[FILL, VENT]] = np.maximum(sums_s - theta[VISCOUS] / theta[SPRING], 0.0)
        for width in widths:
            theta, own = _aligned(breakaways, mass_kg, gain, theta, width)
        tell(_ALIGNED_PART)
    strokes = weakened(strokes, wrong)
    starts: list[Array] = []
    for dead_s in (np.zeros(1), np.r_[0.0, np.geomspace(0.0005, 0.05, 9)]):
        start, off_sigmas = theta, _OFF_SIGMAS
        for factors in (np.geomspace(0.2, 5.0, 17), np.geomspace(0.8, 1.25, 9)):
            sums = Sums(sums_s, sigma_s, off_sigmas)
            start, nearest = _divided(steps, mass_kg, gain, start, ramp, sums, start[VISCOUS] * factors, dead_s)
            off_sigmas = nearest + 0.25 * _OFF_SIGMAS
        tell(_DIVIDED_PART)
        if not any(np.array_equal(start, other) for other in starts):
            starts.append(start)
    seen = stribeck_is_seen(strokes, gain, theta, prior)
    if seen:  # F_c and V_s explain slow strokes nearly alike: several beginnings, too
        starts = [_with_stribeck(start, factor * prior.theta[STRIBECK]) for start in starts for factor in _FACTORS]
    still = tuple(np.zeros((2, len(each.rest_m))) for each in (strokes, steps))
    for number in range(_ROUNDS):
        # without a dead time, and with one: between the two lie hills that no descent crosses
        fixed = [STATIC] if seen else [STATIC, STRIBECK]
        begins = [Beginning(bound(prior, start, fixed), start, still) for start in starts]
        low, high = (_DIVIDED_PART + (1.0 - _DIVIDED_PART) * part / _ROUNDS for part in (number, number + 1))
        found = fits([strokes, steps], mass_kg, gain, begins, _SCATTER, _DONE, part_of(tell, low, high))
        theta = min(found, key=lambda one: one.cost).theta
        for width in _WIDTHS[1:]:
            theta, own = _aligned(breakaways, mass_kg, gain, theta, width)
        starts = [theta]
    return theta, own


def part_of(tell: Callable[[float], object], low: float, high: float) -> Callable[[float], object]:
    """Return a function that tells the part of a stage, which is the whole from `low` to `high`."""
    return lambda part: tell(low + (high - low) * part)


def _with_stribeck(theta: Array, velocity: float) -> Array:
    after = theta.copy()
    after[STRIBECK] = velocity
    return after


def bound(prior: Prior, theta: Array, numbers: list[int]) -> Prior:
    """Return the prior in which some of the parameters are held at their values in θ."""
    held, sigma = prior.theta.copy(), prior.sigma.copy()
    held[numbers], sigma[numbers] = theta[numbers], _FIXED
    return Prior(held, sigma)


def stribeck_is_seen(strokes: Observed, gain: float, theta: Array, prior: Prior) -> bool:
    """Return whether a stroke is so slow that its friction depends on V_s; a slip alone is too short to show it."""
    rows, _ = _sliding_rows(strokes, 0.0)
    return bool(rows[:, 5].min() * gain / theta[SPRING] < _SLOW * prior.theta[STRIBECK])


@dataclass(frozen=True, slots=True)
class Sums:
    """τ + T_d + F_v/K up and down in s, their σ, and by how many σ it may be off."""

    up_down_s: Array
    sigma_s: float
    off_sigmas: Array


def _lines(strokes: Observed, gain: float, theta: Array) -> tuple[Array, Array, float, float]:
    """Return θ with the lines of the sliding stem, how long they follow the current: τ + T_d + F_v/K, σ of it, excess.

    Then K·x = B·(u - s·r·S) - F_0 - s·F(v), with the ramp's rate r and v = B·r/K; each direction has its own S.
    """
    period_s = strokes.slips.period_s
    sums_s = np.zeros(2)
    for _ in range(_ROUNDS):
        rows, wanted = _sliding_rows(strokes, 4.0 * float(sums_s.max()))
        speed = rows[:, 5] * gain / theta[SPRING]
        excess_n = max(theta[STATIC] - theta[COULOMB], 0.1 * theta[COULOMB])
        best = np.inf
        for factor in (1.0, *np.geomspace(0.2, 5.0, 25)):
            stribeck = factor * theta[STRIBECK]
            fading = excess_n * np.exp(-((speed / stribeck) ** 2)) * rows[:, 2] / theta[SPRING]
            columns = rows[:, :5] * rows[:, 6:7]
            found, *_ = np.linalg.lstsq(columns, (wanted + fading) * rows[:, 6], rcond=None)
            off = (wanted + fading) * rows[:, 6] - columns @ found
            if float(off @ off) < 0.98 * best:
                best, chosen, lines, left = float(off @ off), stribeck, found, off
                inverse = np.linalg.pinv(columns.T @ columns)
        after = theta.copy()
        after[SPRING] = gain / lines[0]
        after[PRELOAD] = -lines[1] * after[SPRING]
        after[COULOMB] = max(-lines[2] * after[SPRING], 0.01 * theta[COULOMB])
        after[STRIBECK] = chosen
        sums_s = np.maximum(-np.array([lines[3], -lines[4]]) / lines[0] + 0.5 * period_s, 0.0)
        wrong = excess(left, _BLOCK)
        sigma_s = float(np.sqrt(np.mean(np.diag(inverse)[3:]) * wrong) / abs(lines[0]))
        theta = after
    return theta, sums_s, sigma_s, wrong


def _sliding_rows(strokes: Observed, settles_s: float) -> tuple[Array, Array]:
    """Return the rows u, 1, s, r up, r down, r, weight, and the readings, where the stem slides steadily."""
    slips, found = strokes.slips, []
    for number, direction in enumerate(slips.direction):
        slides = np.flatnonzero(strokes.weight[number] > 0.0)
        if not len(slides):
            continue
        later = slides[min(round(settles_s / slips.period_s), 2 * len(slides) // 3) :]
        current = slips.applied_ma[number, later]
        rate = abs(float(np.median(np.diff(current)))) / slips.period_s
        ones = np.ones(len(later))
        up, down = (rate, 0.0) if direction > 0.0 else (0.0, rate)
        found.append(
            np.stack(
                [
                    current,
                    ones,
                    direction * ones,
                    up * ones,
                    down * ones,
                    rate * ones,
                    strokes.weight[number, later],
                    slips.measured_m[number, later],
                ],
                axis=1,
            )
        )
    rows = np.concatenate(found)
    return rows[:, :7], rows[:, 7]


def _aligned(observed: Observed, mass_kg: float, gain: float, theta: Array, widest: float) -> tuple[Array, Array]:
    """Return θ with the static friction at which the slips begin when they were seen to, and what each differs from it.

    Least squares alone would not find it: a slip that begins at another moment has no reading in common.
    """
    tries = widest * np.linspace(-1.0, 1.0, _TRIES)
    own = np.zeros((_TRIES, 2, len(observed.rest_m)))
    own[:, 1, :] = tries[:, None]
    found = residuals(
        observed, play(observed.slips, sets_of(np.tile(theta, (_TRIES, 1)), own, observed, mass_kg, gain))
    )
    best = tries[np.argmin(np.sum(found * found, axis=0), axis=0)]
    middle = float(np.median(best))
    after = theta.copy()
    after[STATIC] *= 1.0 + middle
    mine = np.zeros((2, len(observed.rest_m)))
    mine[1] = (1.0 + best) / (1.0 + middle) - 1.0
    return after, mine


def _divided(
    steps: Observed,
    mass_kg: float,
    gain: float,
    theta: Array,
    ramp: float,
    sums: Sums,
    viscous: Array,
    dead_s: Array,
) -> tuple[Array, float]:
    """Return θ with the lags, the dead time and F_v that explain the steps best, and by how many σ their sum is off."""
    ways, offs = [], []
    for off in sums.off_sigmas:
        sums_s = np.maximum(sums.up_down_s + off * sums.sigma_s, 0.0)
        for friction in viscous:
            for late_s in dead_s:
                rest_s = late_s + friction / theta[SPRING]
                if late_s and sums_s.mean() < rest_s:
                    continue
                way = theta.copy()
                way[[VISCOUS, DEAD]] = friction, late_s
                way[[FILL, VENT]] = np.maximum(sums_s - rest_s, 0.0)
                later_s = float(np.mean(way[[FILL, VENT]] - theta[[FILL, VENT]])) + late_s - theta[DEAD]
                way[STATIC] = max(way[STATIC] - gain * ramp * later_s, way[COULOMB])
                ways.append(way)
                missing_s = min(float(sums_s.mean()) - rest_s, 0.0)
                offs.append(abs(off) + abs(missing_s) / sums.sigma_s)
    thetas = np.stack(ways)
    own = np.zeros((len(thetas), 2, len(steps.rest_m)))
    found = residuals(steps, play(steps.slips, sets_of(thetas, own, steps, mass_kg, gain)))
    costs = np.sum(found * found, axis=(0, 2))
    readings = max(int(np.count_nonzero(found[:, 0, :])), 1)
    costs /= max(float(costs.min()) / readings, 1.0)
    best = int(np.argmin(costs + np.square(offs)))
    nearest = float(np.mean(thetas[best][[FILL, VENT]]) + thetas[best][DEAD] + thetas[best][VISCOUS] / theta[SPRING])
    return np.asarray(thetas[best]), (nearest - float(sums.up_down_s.mean())) / sums.sigma_s
