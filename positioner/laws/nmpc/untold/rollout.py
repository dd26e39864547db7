"""The motion of a course as one candidate predicts it, and what the readings say of the load. Pure.

The closed form of a slide (`valve.motion`) gives the derivatives, too: so one run gives the normal equations of a
Gauss-Newton step for the origin (in mm), K, F_c and F_v. A few steps of the motion are computed in each cycle.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass, replace
from positioner.valve.motion import Load

if TYPE_CHECKING:
    from positioner.laws.nmpc.untold.candidate import Pressures
    from positioner.laws.nmpc.untold.course import Course
    from positioner.laws.nmpc.untold.load import Nominal

STATES = 4
_MM = 1e-3
_FAR2 = 9.0
"""The square of a residual, in its variance, from which on it costs less and less: it may be an outlier (Cauchy).
The steps of the fit follow it by its size (Huber): by Cauchy's weights a fit that begins far off would stay there."""
_FLOOR_M, _FLOOR_OF_MOVE = 3e-5, 0.02
"""The error of the model: a length, and a part of the way that the stem went."""
_COST_OF_SLIDING = 8
"""What a step of a sliding stem costs, in steps of a resting one."""


@dataclass(slots=True)
class Rollout:
    """How far the computation is.

    step: the next one. x, v, direction, is_moving: the stem. by_x, by_v: derivatives of x and v. sum_m, sums, steps:
    of x and its derivatives over the piece. cost, gradient, information: of the residuals so far.
    """

    step: int
    x: float
    v: float
    direction: float
    is_moving: bool
    by_x: list[float]
    by_v: list[float]
    sum_m: float
    sums: list[float]
    steps: int
    cost: float
    gradient: list[float]
    information: list[list[float]]


def begun(course: Course, origin_mm: float) -> Rollout:
    """Return the beginning of a motion whose origin is `origin_mm` beside the average of the course."""
    return Rollout(
        0,
        course.origin_m + _MM * origin_mm,
        0.0,
        course.direction,
        False,
        [_MM, 0.0, 0.0, 0.0],
        [0.0] * STATES,
        0.0,
        [0.0] * STATES,
        0,
        0.0,
        [0.0] * STATES,
        [[0.0] * STATES for _ in range(STATES)],
    )


def variance_m2(course: Course, noise_m2: float, samples: int) -> float:
    """Return the variance of the mean of so many readings against the model."""
    floor_m = _FLOOR_M + _FLOOR_OF_MOVE * abs(course.moved_m)
    return noise_m2 / samples + floor_m * floor_m


def advanced(
    nominal: Nominal,
    course: Course,
    given: Pressures,
    values: list[float],
    onset: int,
    noise_m2: float,
    before: Rollout,
    budget: int,
) -> Rollout:
    """Return the computation after as many steps as `budget` allows, with these multiples of the load.

    The stem slides from step `onset` on, -1 for never; later it sticks and slips by the load.
    """
    now = replace(before)
    now.by_x, now.by_v, now.sums = now.by_x[:], now.by_v[:], now.sums[:]
    now.gradient, now.information = now.gradient[:], [row[:] for row in now.information]
    own, model = nominal.load, nominal.model
    load = Load(values[0] * own.spring_n_per_m, values[1] * own.friction_n, values[2] * own.viscous_n_s_per_m)
    static_n, last = values[3] * nominal.static_n, len(given.piece) - 1
    while now.step <= last and budget > 0:
        step = now.step
        budget -= 1
        if not now.is_moving and 0 <= onset <= step:
            force_n = model.push_n(given.mean_ma[step], 0.0, 0.0) - load.spring_n_per_m * now.x
            if step == onset or abs(force_n) > static_n:
                now.direction = course.direction if step == onset else math.copysign(1.0, force_n)
                now.is_moving, now.v, now.by_v = True, 0.0, [0.0] * STATES
        if now.is_moving:
            budget -= _COST_OF_SLIDING
            _slide(nominal, load, given.mean_ma[step], given.length_s[step], now)
        now.sum_m += now.x
        now.steps += 1
        for i in range(STATES):
            now.sums[i] += now.by_x[i]
        index = given.piece[step]
        if step == last or given.piece[step + 1] != index:
            _compare(course, noise_m2, index, now)
        now.step = step + 1
    return now


def _slide(nominal: Nominal, load: Load, current_ma: float, length_s: float, now: Rollout) -> None:
    """Advance a sliding stem, and its derivatives."""
    own, s = nominal.load, now.direction
    end = nominal.model.step(now.x, now.v, current_ma, load, s, length_s)
    by_x, by_v = now.by_x, now.by_v
    for i in range(STATES):
        x, v = by_x[i], by_v[i]
        by_x[i] = end.dx_dx * x + end.dx_dv * v
        by_v[i] = end.dv_dx * x + end.dv_dv * v
    by_x[1] += end.dx_dk * own.spring_n_per_m
    by_v[1] += end.dv_dk * own.spring_n_per_m
    by_x[2] -= s * end.dx_dq * own.friction_n
    by_v[2] -= s * end.dv_dq * own.friction_n
    by_x[3] += end.dx_dc * own.viscous_n_s_per_m
    by_v[3] += end.dv_dc * own.viscous_n_s_per_m
    now.x, now.v = end.x, end.v
    if end.stopped:
        now.is_moving = False


def _compare(course: Course, noise_m2: float, index: int, now: Rollout) -> None:
    """Add what the readings of a piece say: at the end of a sample, or the mean of several."""
    piece = course.pieces[index]
    place_m, slopes = now.x, now.by_x
    if piece.samples > 1:
        place_m, slopes = now.sum_m / now.steps, [total / now.steps for total in now.sums]
    error_m, variance = piece.reading_m - place_m, variance_m2(course, noise_m2, piece.samples)
    stretch2 = error_m * error_m / (variance * _FAR2)
    weight = (1.0 if stretch2 < 1.0 else 1.0 / math.sqrt(stretch2)) / variance
    now.cost += _FAR2 * math.log(1.0 + stretch2)
    for i in range(STATES):
        by = weight * slopes[i]
        now.gradient[i] += by * error_m
        row = now.information[i]
        for j in range(STATES):
            row[j] += by * slopes[j]
    now.sum_m, now.steps, now.sums = 0.0, 0, [0.0] * STATES
