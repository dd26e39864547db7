"""The iterative LTV-QP of the law `nmpc`: as fast as can be, and never too fast to stop at the target. Pure.

The paper's movable speed bound v ≤ restVel(r - x) (eqs 22 to 24) is here the exact one: the speed from which braking
with a given current ends at r. As a bound on the state, s·X(x, v) ≤ s·r with X the stopping point, it is linearised
along the prediction, at every step of the horizon and in every pass (steps 1 to 5 of paper §4.1). Where the present
speed breaks it already, it is relaxed to what full braking reaches (D10): a programme always has a solution.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Interval

from positioner.adaptive_slide import STOPPING_TIME_S
from positioner.qp import QuadraticProgram

if TYPE_CHECKING:
    from positioner.adaptive_slide import Slider
    from positioner.planner import Solver


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachSettings:
    """The `[control.nmpc.approach]` table of a configuration.

    prediction_steps, control_steps: H_p, H_u.
    terminal_factor: weight of the last predicted error, relative to the others.
    input_weight: weight of a current away from the braking current, relative to that of the error it makes.
    max_passes, pass_tolerance_ma: when the passes end.
    """

    __pydantic_config__: ClassVar = {"extra": "forbid", "allow_inf_nan": False}

    prediction_steps: Annotated[int, Interval(ge=1, le=100)] = 4
    control_steps: Annotated[int, Interval(ge=1, le=100)] = 4
    terminal_factor: Annotated[float, Interval(ge=0.0, le=1e3)] = 3.0
    input_weight: Annotated[float, Interval(gt=0.0, le=1e3)] = 1e-3
    max_passes: Annotated[int, Interval(ge=1, le=50)] = 6
    pass_tolerance_ma: Annotated[float, Interval(gt=0.0, le=1.0)] = 5e-3

    def __post_init__(self) -> None:
        """Refuse a control horizon beyond the prediction."""
        if self.control_steps > self.prediction_steps:
            raise ValueError("control_steps exceeds prediction_steps")


class Course(NamedTuple):
    """A move to be planned: from x (m) and v (m/s) in `direction` (±1) to the target, with K (N/m) and F (N).

    brake_ma: the current that the stem is to stop under, in the stick band of the target.
    weakest_ma, strongest_ma: the least and the most current, seen in the direction of the move.
    release_ma: the least current of the first step, Γ for a stem that still sticks (eqs 25, 26), else `weakest_ma`.
    """

    x: float
    v: float
    direction: float
    target_m: float
    spring_n_per_m: float
    friction_n: float
    brake_ma: float
    weakest_ma: float
    strongest_ma: float
    release_ma: float


@dataclass(frozen=True, slots=True)
class Approach:
    """The plan: inputs (H_u) in mA, the speed bound of the first step in m/s, passes, and whether they converged."""

    inputs_ma: tuple[float, ...]
    speed_limit_m_per_s: float
    passes: int
    converged: bool


class _Line(NamedTuple):
    """The prediction along given inputs: positions (H_p), stopping points (H_p), and their derivatives (H_p, H_u)."""

    positions: list[float]
    stops: list[float]
    position_rows: list[list[float]]
    stop_rows: list[list[float]]
    speed_limit: float


def approach(
    settings: ApproachSettings,
    slider: Slider,
    solver: Solver,
    course: Course,
    guess_ma: tuple[float, ...],
    period_s: float,
) -> Approach | None:
    """Return the plan for `course`, or None when a programme was not solved; guess_ma (H_u) starts the passes."""
    low, high = sorted((course.weakest_ma, course.strongest_ma))
    first_low, first_high = sorted((course.release_ma, course.strongest_ma))
    inputs = np.clip(guess_ma, low, high)
    inputs[0] = min(max(inputs[0], first_low), first_high)
    passes, change = 0, np.inf
    line = predict(settings, slider, course, inputs.tolist(), period_s)
    while passes < settings.max_passes and change >= settings.pass_tolerance_ma:
        solution = solver.solve(program(settings, course, line, inputs))
        if solution is None:
            return None
        found = np.clip(solution.z, low, high)
        found[0] = min(max(found[0], first_low), first_high)
        passes, change, inputs = passes + 1, abs(float(found[0] - inputs[0])), found
        if change >= settings.pass_tolerance_ma:
            line = predict(settings, slider, course, inputs.tolist(), period_s)
    return Approach(tuple(inputs.tolist()), line.speed_limit, passes, change < settings.pass_tolerance_ma)


def predict(
    settings: ApproachSettings, slider: Slider, course: Course, inputs_ma: list[float], period_s: float
) -> _Line:
    """Return the exact motion under `inputs_ma` (H_u), the last one held, linearised step by step."""
    s, K, F, gain = course.direction, course.spring_n_per_m, course.friction_n, slider.gain_n_per_ma
    count = len(inputs_ma)
    brake_n = slider.push_n(course.brake_ma, s, F)
    x, v = course.x, course.v
    x_row, v_row = [0.0] * count, [0.0] * count
    line = _Line([], [], [], [], 0.0)
    limit = 0.0
    for step in range(settings.prediction_steps):
        # Loop invariant: x_row and v_row are the derivatives of x and v to the inputs
        index = min(step, count - 1)
        move = slider.flow(x, v, slider.push_n(inputs_ma[index], s, F), K, s, period_s)
        x_row, v_row = (
            [move.dx_dx * a + move.dx_dv * b for a, b in zip(x_row, v_row, strict=True)],
            [move.dv_dx * a + move.dv_dv * b for a, b in zip(x_row, v_row, strict=True)],
        )
        x_row[index] += move.dx_dq * gain
        v_row[index] += move.dv_dq * gain
        x, v = move.x, move.v
        stop = slider.flow(x, v, brake_n, K, s, STOPPING_TIME_S)
        line.positions.append(x)
        line.stops.append(stop.x)
        line.position_rows.append(x_row)
        line.stop_rows.append([stop.dx_dx * a + stop.dx_dv * b for a, b in zip(x_row, v_row, strict=True)])
        if step == 0:
            limit = v + (course.target_m - stop.x) / stop.dx_dv if stop.dx_dv > 0.0 else v
    return line._replace(speed_limit=limit)


def program(
    settings: ApproachSettings, course: Course, line: _Line, inputs_ma: np.ndarray[tuple[int], np.dtype[np.float64]]
) -> QuadraticProgram:
    """Return the programme in the inputs (H_u): tracking, the limits of the current, and the H_p stopping points.

    Positions are scaled so that the first input moves the last one by 1; stopping points, by the first one.
    """
    s, count = course.direction, len(inputs_ma)
    rows = np.array(line.position_rows)
    unit = rows[-1, 0] or 1.0
    rows /= unit
    weights = np.ones(settings.prediction_steps)
    weights[-1] = settings.terminal_factor
    weighted = rows.T * weights
    errors = (course.target_m - np.array(line.positions)) / unit + rows @ inputs_ma
    P = weighted @ rows + settings.input_weight * np.eye(count)
    q = -(weighted @ errors) - settings.input_weight * course.brake_ma

    stops = s * np.array(line.stop_rows)
    scale = abs(stops[0, 0]) or 1.0
    stops /= scale
    low, high = sorted((course.weakest_ma, course.strongest_ma))
    first_low, first_high = sorted((course.release_ma, course.strongest_ma))
    braking = np.full(count, course.weakest_ma)
    braking[0] = course.release_ma
    room = s * (course.target_m - np.array(line.stops)) / scale + stops @ inputs_ma
    lower, upper = np.full(count + len(stops), -_FREE), np.empty(count + len(stops))
    lower[:count], upper[:count] = low, high
    lower[0], upper[0] = first_low, first_high
    upper[count:] = np.maximum(room, stops @ braking)
    return QuadraticProgram(P, q, np.vstack([np.eye(count), stops]), lower, upper)


_FREE = 1e6
"""A bound that no row of the programme comes near."""
