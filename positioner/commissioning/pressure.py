"""Lag and dead time from the measured pressure, where the hardware sends ACTUATOR_STATE. Pure.

The pressure follows the current by ṗ = (u(t - T_d) - p)/τ whatever the stem does, so the steps show the three times
directly. What they show becomes what the fit of the positions believes before.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from positioner.commissioning.record import Kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.commissioning.record import Stretch

    Array = NDArray[np.float64]

_LAGS_S = np.r_[0.0, np.geomspace(0.0005, 1.0, 28)]
_DEAD_PERIODS = np.r_[0.0, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 18.0, 27.0, 40.0]
_ROUNDS, _FINER = 16, 0.65
_AROUND = np.linspace(-1.0, 1.0, 5)


def times_of(stretches: Sequence[Stretch], period_s: float) -> tuple[Array, Array] | None:
    """Return fill lag, vent lag and dead time in s, and σ of each; None where no pressure was measured.

    They are searched on grids, each finer than the one before: at 0 and at whole periods the slopes are not continuous.
    """
    steps = [each for each in stretches if each.kind is Kind.STEP and each.pressure_pa]
    if not steps:
        return None
    count = min(len(each.measured_m) - each.held for each in steps) + 1
    applied = np.array([each.applied_ma[each.held - 1 : each.held - 1 + count] for each in steps])
    measured = np.array([each.pressure_pa[each.held - 1 : each.held - 1 + count] for each in steps])
    sets = np.array([(lag, lag, dead * period_s) for lag in _LAGS_S for dead in _DEAD_PERIODS])
    widths = np.array([0.0, 0.0, 0.0])
    for number in range(_ROUNDS):
        costs = np.sum(_residuals(applied, measured, sets, period_s) ** 2, axis=1)
        theta = sets[int(np.argmin(costs))]
        widths = np.maximum(0.5 * theta, period_s) if number == 0 else _FINER * widths
        around = np.stack(np.meshgrid(*(widths[:, None] * _AROUND), indexing="ij"), axis=-1).reshape(-1, 3)
        sets = np.maximum(theta + around, 0.0)
    change = np.maximum(1e-3 * theta, 0.02 * period_s)
    found = _residuals(applied, measured, theta + np.r_[np.zeros((1, 3)), np.diag(change)], period_s)
    slopes = (found[1:] - found[0]).T / change
    spread = float(found[0] @ found[0]) / measured.size
    sigma = np.sqrt(np.maximum(np.diag(np.linalg.pinv(slopes.T @ slopes)), 0.0) * spread)
    return theta, np.hypot(sigma, 0.05 * period_s)


def _residuals(applied: Array, measured: Array, sets: Array, period_s: float) -> Array:
    """Return measured less played pressure in Pa, (set, reading), after the line that fits best between the two."""
    played = _played(applied, sets, period_s).reshape(len(sets), -1)
    played -= played.mean(axis=1, keepdims=True)
    wanted = measured.ravel() - measured.mean()
    slope = played @ wanted / np.maximum(np.sum(played * played, axis=1), 1e-12)
    return np.asarray(wanted - slope[:, None] * played)


def _played(applied: Array, sets: Array, period_s: float) -> Array:
    """Return the pressure in mA at each reading, (set, stretch, sample), of sets (fill, vent, dead time)."""
    fill, vent = (np.exp(-period_s / np.maximum(sets[:, number, None], 1e-9)) for number in (0, 1))
    delay = sets[:, 2, None] / period_s
    whole = np.floor(delay).astype(np.int64)
    late = delay - whole
    rows = np.arange(len(applied))[None, :]
    pressure = np.broadcast_to(applied[:, 0], (len(sets), len(applied))).copy()
    found = np.empty((len(sets), *applied.shape))
    for k in range(applied.shape[1]):
        for part, back in ((late, 1), (1.0 - late, 0)):
            target = applied[rows, np.maximum(k - whole - back, 0)]
            rises = target > pressure
            # e^(-t/τ) of a part of the period is a power of that of the period
            share = np.where(rises, fill, vent) ** part
            pressure = target + (pressure - target) * share
        found[:, :, k] = pressure
    return found
