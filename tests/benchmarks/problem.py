"""The programme of one pass as a linear time-varying control problem, which every other program is given.

Its variables are the deviations from the guess: δx(0) = 0, δx(i+1) = A(i) δx(i) + b(i) δu(i), where x is the position
and the speed. It minimises Σ w(i) (δp(i+1) - e(i))² + r Σ (δu(i) - t(i))², with δu between `low` and `high` and
g(i)·δx(i+1) ≤ room(i). Positions and stopping points are scaled as `positioner.laws.nmpc.plan` scales them; speeds, so
that the first input moves the first one by 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from positioner.valve.motion import STOPPING_TIME_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.plans import Planned
    from positioner.laws.nmpc.settings import ApproachSettings
    from positioner.valve.motion import MotionModel

    Array = NDArray[np.float64]

_REACH = 20.0
_LEAST_M_PER_MA = 1e-9


@dataclass(frozen=True, slots=True)
class ControlProblem:
    """One problem: A (N, 2, 2), b (N, 2), errors e (N,), weights w (N,), r, targets t (N,), g (N, 2), room (N,).

    low, high (N,): the limits of δu in mA; guess_ma (N,): what δu is added to.
    """

    A: Array
    b: Array
    errors: Array
    weights: Array
    input_weight: float
    targets: Array
    g: Array
    room: Array
    low: Array
    high: Array
    guess_ma: Array

    @property
    def steps(self) -> int:
        """The horizon N."""
        return len(self.errors)

    def with_speed(self, scale: float) -> ControlProblem:
        """Return the same problem with speeds in a unit that makes their numbers smaller by `scale`."""
        states = np.array([1.0, scale])
        A = self.A / states * states[:, np.newaxis]
        return replace(self, A=A, b=self.b * states, g=self.g / states)


def control_problem(
    settings: ApproachSettings, model: MotionModel, planned: Planned, period_s: float
) -> ControlProblem:
    """Return the problem that the first pass of `plan_move` solves; independent of its programme."""
    move, guess = planned.move, np.array(planned.guess_ma)
    s, load, count = move.direction, move.load, len(guess)
    low, high = np.full(count, move.weakest_ma), np.full(count, move.strongest_ma)
    low[0] = move.release_ma
    if s < 0.0:
        low, high = high, low
    guess = np.clip(guess, low, high)
    A, b, g = np.zeros((count, 2, 2)), np.zeros((count, 2)), np.zeros((count, 2))
    positions, stops = np.zeros(count), np.zeros(count)
    x, v = move.x, move.v
    for i, current_ma in enumerate(guess.tolist()):
        end = model.step(x, v, current_ma, load, s, period_s)
        A[i] = (end.dx_dx, end.dx_dv), (end.dv_dx, end.dv_dv)
        b[i] = end.dx_dq * model.gain_n_per_ma, end.dv_dq * model.gain_n_per_ma
        x, v = end.x, end.v
        stop = model.step(x, v, move.brake_ma, load, s, STOPPING_TIME_S)
        positions[i], stops[i] = x, stop.x
        g[i] = stop.dx_dx, stop.dx_dv
    forced = _forced(A, b)
    unit = float(forced[-1, 0, 0]) or 1.0
    stop_rows = s * np.einsum("ij,ijk->ik", g, forced)
    scales = np.maximum(np.abs(stop_rows).max(axis=1), _LEAST_M_PER_MA)
    room = s * (move.target_m - stops) / scales
    # D10: where the bound is broken already, it is what full braking reaches
    braking = (low if s > 0.0 else high) - guess
    room = np.maximum(room, stop_rows @ braking / scales)
    weights = np.ones(count)
    weights[-1] = settings.terminal_factor
    scale = np.array([unit, float(b[0, 1]) or 1.0])
    return ControlProblem(
        A=A * scale / scale[:, np.newaxis],
        b=b / scale,
        errors=np.clip((move.target_m - positions) / unit, -_REACH, _REACH),
        weights=weights,
        input_weight=settings.input_weight,
        targets=move.brake_ma - guess,
        g=s * g * scale / scales[:, np.newaxis],
        room=room,
        low=low - guess,
        high=high - guess,
        guess_ma=guess,
    )


def _forced(A: Array, b: Array) -> Array:
    """Return the derivatives of δx(i+1) to δu(k), (N, 2, N)."""
    count = len(b)
    forced, response = np.zeros((count, 2, count)), np.zeros((2, count))
    for i in range(count):
        response = A[i] @ response
        response[:, i] += b[i]
        forced[i] = response
    return forced
