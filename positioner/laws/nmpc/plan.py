"""The iterative LTV-QP of the law `nmpc`: to the target in the shortest time, and never too fast to stop there. Pure.

The paper's movable speed bound v ≤ restVel(r - x) (eqs 22 to 24) is here the exact one: the speed from which braking
with a given current ends at r. As a bound on the state, s·X(x, v) ≤ s·r with X the stopping point, it is linearised
along the prediction, at every step of the horizon and in every pass (steps 1 to 5 of paper §4.1). Where the present
speed breaks it already, it is relaxed to what full braking reaches (D10): a programme always has a solution.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.prediction import predict
from positioner.laws.nmpc.programme import Limits, cost_of, program
from positioner.values import dataclass
from positioner.valve.slide import slide_of

if TYPE_CHECKING:
    from positioner.laws.nmpc.settings import ApproachSettings
    from positioner.optimization.qp import Solver
    from positioner.valve.motion import Load, MotionModel
    from positioner.valve.slide import Slide


@dataclass(frozen=True, slots=True)
class Move:
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

    def slide(self, model: MotionModel, period_s: float) -> Slide:
        """Return the constants of the slide that the move is."""
        return slide_of(model, self.load, self.direction, period_s, self.brake_ma)

    def smallest_m(self, slide: Slide) -> float:
        """Return where in m the stem stops after the smallest push: one sample of the least current, then braking."""
        x, v = slide.after(self.x, self.v, self.release_ma)
        return slide.stop(x, v)[0]


@dataclass(frozen=True, slots=True)
class MovePlan:
    """The plan: inputs (H_u) in mA, the speed bound after the first step in m/s, and the passes it took."""

    inputs_ma: tuple[float, ...]
    speed_limit_m_per_s: float
    passes: int


def plan_move(
    settings: ApproachSettings,
    model: MotionModel,
    solver: Solver,
    move: Move,
    guess_ma: tuple[float, ...],
    period_s: float,
) -> MovePlan | None:
    """Return the plan for `move`, or None when a programme was not solved; guess_ma (H_u) starts the passes."""
    slide = move.slide(model, period_s)
    steps, count = settings.prediction_steps, len(guess_ma)
    x, v, target_m = move.x, move.v, move.target_m
    braking = [move.weakest_ma] * count
    braking[0] = move.release_ma
    if move.direction * (move.smallest_m(slide) - target_m) >= 0.0:
        # even the least current does not stop the stem before the target: a programme would have this one solution
        trajectory = predict(slide, 1, x, v, target_m, braking)
        return MovePlan(tuple(braking), trajectory.speed_limit, 0)
    limits = Limits(braking, [move.strongest_ma] * count, move.brake_ma)
    inputs = _within(list(guess_ma), limits, move.direction)
    cost = cost_of(settings, slide)
    passes, change = 0, math.inf
    while change >= settings.pass_tolerance_ma and passes < settings.max_passes:
        trajectory = predict(slide, steps, x, v, target_m, inputs)
        posed, _ = program(cost, slide, limits, target_m, trajectory, inputs)
        solution = solver.solve(posed)
        if solution is None:
            return None
        found = _within(solution, limits, move.direction)
        change = max(abs(new - old) for new, old in zip(found, inputs, strict=True))
        passes, inputs = passes + 1, found
    return MovePlan(tuple(inputs), trajectory.speed_limit, passes)


def _within(inputs_ma: list[float], limits: Limits, direction: float) -> list[float]:
    low, high = (limits.braking, limits.driving) if direction > 0.0 else (limits.driving, limits.braking)
    return [min(max(each, low[i]), high[i]) for i, each in enumerate(inputs_ma)]
