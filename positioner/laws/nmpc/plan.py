"""The iterative LTV-QP of the law `nmpc`: to the target in the shortest time, and never too fast to stop there. Pure.

The paper's movable speed bound v ≤ restVel(r - x) (eqs 22 to 24) is here the exact one: the speed from which braking
with a given current ends at r. As a bound on the state, s·X(x, v) ≤ s·r with X the stopping point, it is linearised
along the prediction, at every step of the horizon and in every pass (steps 1 to 5 of paper §4.1). Where the present
speed breaks it already, it is relaxed to what full braking reaches (D10): a programme always has a solution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
from annotated_types import Interval

from positioner.inputs.table import SettingsTable
from positioner.optimization.qp import QuadraticProgram
from positioner.valve.motion import STOPPING_TIME_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from positioner.optimization.qp import Solver
    from positioner.valve.motion import Load, MotionModel


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachSettings(SettingsTable):
    """The `[control.nmpc.approach]` table of a configuration.

    prediction_steps, control_steps: H_p, H_u.
    terminal_factor: weight of the last predicted error, relative to the others.
    input_weight: weight of a current away from the braking current, relative to that of the error it makes.
    max_passes, pass_tolerance_ma: the passes end when no input changes by more, so that the bound holds at every step.
    """

    prediction_steps: Annotated[int, Interval(ge=1, le=100)] = 4
    control_steps: Annotated[int, Interval(ge=1, le=100)] = 4
    terminal_factor: Annotated[float, Interval(ge=0.0, le=1e3)] = 3.0
    input_weight: Annotated[float, Interval(gt=0.0, le=1e3)] = 0.03
    max_passes: Annotated[int, Interval(ge=1, le=50)] = 6
    pass_tolerance_ma: Annotated[float, Interval(gt=0.0, le=1.0)] = 5e-3

    def __post_init__(self) -> None:
        """Refuse a control horizon beyond the prediction."""
        if self.control_steps > self.prediction_steps:
            raise ValueError("control_steps exceeds prediction_steps")


class Move(NamedTuple):
    """A move to be planned: from x (m) and v (m/s) in `direction` (±1) to the target, against `load`.

    brake_ma: the current that the stem is to stop under, in the stick band of the target.
    weakest_ma, strongest_ma: the least and the most current, seen in the direction of the move.
    release_ma: the least current of the first step, Γ for a stem that still sticks (eqs 25, 26), else `weakest_ma`.
    """

    x: float
    v: float
    direction: float
    target_m: float
    load: Load
    brake_ma: float
    weakest_ma: float
    strongest_ma: float
    release_ma: float

    def smallest_m(self, model: MotionModel, period_s: float) -> float:
        """Return where in m the stem stops after the smallest push: one sample of the least current, then braking."""
        s, load = self.direction, self.load
        pushed = model.step(self.x, self.v, self.release_ma, load, s, period_s)
        return model.step(pushed.x, pushed.v, self.brake_ma, load, s, STOPPING_TIME_S).x


@dataclass(frozen=True, slots=True)
class MovePlan:
    """The plan: inputs (H_u) in mA, the speed bound after the first step in m/s, and the passes it took."""

    inputs_ma: tuple[float, ...]
    speed_limit_m_per_s: float
    passes: int


class Trajectory(NamedTuple):
    """The prediction along given inputs: positions (H_p), stopping points (H_p), and their derivatives (H_p, H_u)."""

    positions: list[float]
    stops: list[float]
    position_rows: list[list[float]]
    stop_rows: list[list[float]]
    speed_limit: float


def plan_move(
    settings: ApproachSettings,
    model: MotionModel,
    solver: Solver,
    move: Move,
    guess_ma: tuple[float, ...],
    period_s: float,
) -> MovePlan | None:
    """Return the plan for `move`, or None when a programme was not solved; guess_ma (H_u) starts the passes."""
    low, high = _limits(move, len(guess_ma))
    braking = [move.release_ma, *(move.weakest_ma,) * (len(guess_ma) - 1)]
    if move.direction * (move.smallest_m(model, period_s) - move.target_m) >= 0.0:
        # even the least current does not stop the stem before the target: a programme would have this one solution
        trajectory = predict(settings, model, move, braking, period_s)
        return MovePlan(tuple(braking), trajectory.speed_limit, 0)
    inputs = np.clip(guess_ma, low, high)
    passes, change = 0, math.inf
    while change >= settings.pass_tolerance_ma and passes < settings.max_passes:
        trajectory = predict(settings, model, move, inputs.tolist(), period_s)
        solution = solver.solve(program(settings, move, trajectory, inputs))
        if solution is None:
            return None
        found = np.clip(solution, low, high)
        passes, change, inputs = passes + 1, float(np.max(np.abs(found - inputs))), found
    return MovePlan(tuple(inputs.tolist()), trajectory.speed_limit, passes)


def predict(
    settings: ApproachSettings, model: MotionModel, move: Move, inputs_ma: list[float], period_s: float
) -> Trajectory:
    """Return the exact motion under `inputs_ma` (H_u), the last one held, linearised step by step."""
    s, load, gain, count = move.direction, move.load, model.gain_n_per_ma, len(inputs_ma)
    x, v = move.x, move.v
    x_row, v_row = [0.0] * count, [0.0] * count
    trajectory = Trajectory([], [], [], [], 0.0)
    limit = 0.0
    for step in range(settings.prediction_steps):
        # Loop invariant: x_row and v_row are the derivatives of x and v to the inputs
        index = min(step, count - 1)
        end = model.step(x, v, inputs_ma[index], load, s, period_s)
        x_row, v_row = (
            [end.dx_dx * a + end.dx_dv * b for a, b in zip(x_row, v_row, strict=True)],
            [end.dv_dx * a + end.dv_dv * b for a, b in zip(x_row, v_row, strict=True)],
        )
        x_row[index] += end.dx_dq * gain
        v_row[index] += end.dv_dq * gain
        x, v = end.x, end.v
        stop = model.step(x, v, move.brake_ma, load, s, STOPPING_TIME_S)
        trajectory.positions.append(x)
        trajectory.stops.append(stop.x)
        trajectory.position_rows.append(x_row)
        trajectory.stop_rows.append([stop.dx_dx * a + stop.dx_dv * b for a, b in zip(x_row, v_row, strict=True)])
        if step == 0:
            limit = v + (move.target_m - stop.x) / stop.dx_dv if stop.dx_dv > 0.0 else v
    return trajectory._replace(speed_limit=limit)


def program(
    settings: ApproachSettings, move: Move, trajectory: Trajectory, inputs_ma: NDArray[np.float64]
) -> QuadraticProgram:
    """Return the programme in the inputs (H_u): tracking, the limits of the current, and the H_p stopping points.

    Positions are scaled so that the first input moves the last one by 1; each stopping point, so that no input moves it
    by more than 1. Far from the target, where the braking current still drives the stem, none of them moves it by much.
    """
    s, count = move.direction, len(inputs_ma)
    rows = np.array(trajectory.position_rows)
    unit = rows[-1, 0] or 1.0
    rows /= unit
    weights = np.ones(settings.prediction_steps)
    weights[-1] = settings.terminal_factor
    weighted = rows.T * weights
    # a target beyond the reach of all currents is moved nearer: better numbers for the solver, and the same plan
    wanted = np.clip((move.target_m - np.array(trajectory.positions)) / unit, -_REACH_MA, _REACH_MA)
    errors = wanted + rows @ inputs_ma
    hessian = weighted @ rows + settings.input_weight * np.eye(count)
    gradient = -(weighted @ errors) - settings.input_weight * move.brake_ma

    stops = s * np.array(trajectory.stop_rows)
    scales = np.maximum(np.abs(stops).max(axis=1), _LEAST_M_PER_MA)
    stops /= scales[:, np.newaxis]
    room = s * (move.target_m - np.array(trajectory.stops)) / scales + stops @ inputs_ma
    low, high = _limits(move, count)
    braking = low if s > 0.0 else high
    lower = np.concatenate([low, np.full(len(stops), -_FREE)])
    upper = np.concatenate([high, np.maximum(room, stops @ braking)])
    return QuadraticProgram(hessian, gradient, np.vstack([np.eye(count), stops]), lower, upper)


def _limits(move: Move, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and the highest inputs (count,) in mA; the first one starts at Γ."""
    braking, driving = np.full(count, move.weakest_ma), np.full(count, move.strongest_ma)
    braking[0] = move.release_ma
    return (braking, driving) if move.direction > 0.0 else (driving, braking)


_LEAST_M_PER_MA = 1e-9
"""An input that moves a stopping point by less counts as one that does not move it."""
_REACH_MA = 20.0
"""No plan needs an error that is larger than the effect of this current."""
_FREE = 1e6
"""A bound that no row of the programme reaches."""
