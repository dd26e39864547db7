"""The iterative LTV-QP of the law `nmpc`: to the target in the shortest time, and never too fast to stop there. Pure.

The paper's movable speed bound v ≤ restVel(r - x) (eqs 22 to 24) is here the exact one: the speed from which braking
with a given current ends at r. As a bound on the state, s·X(x, v) ≤ s·r with X the stopping point, it is linearised
along the prediction, at every step of the horizon and in every pass (steps 1 to 5 of paper §4.1). Where the present
speed breaks it already, it is relaxed to what full braking reaches (D10): a programme always has a solution.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.laws.nmpc.prediction import predict
from positioner.laws.nmpc.programme import program
from positioner.laws.nmpc.start import fastest, multipliers
from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.laws.nmpc.move import Move
    from positioner.laws.nmpc.prediction import Trajectory
    from positioner.laws.nmpc.programme import Pass
    from positioner.laws.nmpc.settings import ApproachSettings
    from positioner.optimization.qp import Solver
    from positioner.valve.motion import MotionModel


@dataclass(frozen=True, slots=True)
class MovePlan:
    """The plan: inputs (H_u) in mA, the speed bound after the first step in m/s, and the passes it took.

    is_solved: whether every programme was; otherwise the inputs are those of the last pass, or the fastest ones.
    """

    inputs_ma: tuple[float, ...]
    speed_limit_m_per_s: float
    passes: int
    is_solved: bool = True


def plan_move(settings: ApproachSettings, model: MotionModel, solver: Solver, move: Move, period_s: float) -> MovePlan:
    """Return the plan for `move`.

    The passes end when the exact motion is that of the linear model: the next pass would change nothing.
    """
    slide = move.slide(model, period_s)
    limits = move.limits(settings.control_steps)
    steps, x, v, target_m = settings.prediction_steps, move.x, move.v, move.target_m
    if move.direction * (move.smallest_m(slide) - target_m) >= 0.0:
        # even the least current does not stop the stem before the target: a programme would have this one solution
        limit = predict(slide, 1, x, v, target_m, limits.braking).speed_limit
        return MovePlan(tuple(limits.braking), limit, 0)
    inputs = fastest(slide, limits, x, v, target_m)
    trajectory = predict(slide, steps, x, v, target_m, inputs)
    passes = 0
    while True:
        posed = program(settings, limits, target_m, trajectory, inputs)
        solution = solver.solve(posed.program, inputs, multipliers(posed, limits, trajectory, inputs))
        if solution is None:
            return MovePlan(tuple(inputs), trajectory.speed_limit, passes, is_solved=False)
        found = limits.cut(solution)
        passes += 1
        plan = MovePlan(tuple(found), trajectory.speed_limit, passes)
        if passes >= settings.max_passes:
            return plan
        ahead = predict(slide, steps, x, v, target_m, found)
        if _error_ma(posed, trajectory, ahead, move.direction, inputs, found) < settings.pass_tolerance_ma:
            return plan
        inputs, trajectory = found, ahead


def _error_ma(
    posed: Pass, before: Trajectory, after: Trajectory, s: float, inputs_ma: list[float], found_ma: list[float]
) -> float:
    """Return the largest error of a linear stopping point under `found_ma`, as the current in mA that moves it so."""
    count, steps, rows, scales = len(inputs_ma), len(before.positions), posed.program.A, posed.scales
    moving, place = len(scales), 0
    errors = [s * (after.stops[i] - before.stops[i]) / scales[i] for i in range(moving)]
    for j in range(count):
        change_ma = found_ma[j] - inputs_ma[j]
        if change_ma != 0.0:
            for i in range(j, moving):
                errors[i] -= rows[place + 1 + i - j] * change_ma
        place += 1 + steps - j
    largest = 0.0
    for each in errors:
        largest = max(largest, abs(each))
    return largest
