"""How far the smallest push takes a stem, and how long a move lasts at best, and with the law `nmpc`. Pure.

The shortest move: all current in one direction, then all in the other, so that the stem stops at its target. The law's
behind a pressure that lags is a braked move (`laws.nmpc.slip`); where none is made, as behind a slew limit
alone, it commands the level at which the stem stops. Without lag it answers a new setpoint one period later, and is as
short as it can be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.laws.nmpc.slip import slip_plan, task_of
from positioner.laws.nmpc.stop import ARRIVED_MA
from positioner.valve.rollout import Moving
from positioner.valve.state import StemState

if TYPE_CHECKING:
    from positioner.laws.nmpc.stop import Task
    from positioner.reach.case import Case
    from positioner.valve.pressure import PressureState
    from positioner.valve.rollout import Rollout

SETTLED_OF_SPAN = 0.01
_SHORTEST_STEP_S, _STEPS_OF_LAG = 2.5e-4, 1000.0
_HALVINGS = 16
_LONGEST_S = 60.0
_PLANNED_OF_SPAN = 0.002
"""So near to its target the law's move is planned to stop, at least."""
_NEARLY = 0.95
"""A slip is nearly over after this part of the natural jump."""
_SLIP_STEP_S = 1e-3


@dataclass(frozen=True, slots=True)
class Durations:
    """Until the stem is within 1 % of span of its target and stays there, in s: the shortest, and the law's."""

    shortest_s: float
    law_s: float


def slip_s(case: Case) -> float:
    """Return after how long in s a slip is nearly over, under the pressure that freed the stem."""
    rollout = case.rollout(_SLIP_STEP_S)
    freed = _freed(rollout, case.middle_m, 1.0)
    over_m = case.middle_m + _NEARLY * case.belief.jump_m
    for sample, moving in enumerate(rollout.path(freed, (freed.pressure.pressure_ma,)), start=1):
        t = sample * _SLIP_STEP_S
        if moving.stem.stuck or moving.stem.position_m >= over_m or t >= _LONGEST_S:
            break
    return t


def smallest_push_m(case: Case, direction: float) -> float:
    """Return how far a stem moves that is freed in `direction` (±1) for one period and the dead time, then braked."""
    rollout, middle_m = case.rollout(), case.middle_m
    moving = _freed(rollout, middle_m, direction)
    moving = rollout.after(moving, moving.pressure.pressure_ma)
    task = _task(case, moving.pressure, middle_m - direction * case.valve.span_m, middle_m)
    path = rollout.path(moving, (*task.currents(0.0), task.hold_ma))
    while not moving.stem.stuck:
        moving = next(path)
    return direction * (moving.stem.position_m - middle_m)


def durations(case: Case, move_m: float) -> Durations:
    """Return the durations of an opening by `move_m` around the middle; infinity where the current is too weak."""
    start_m = case.middle_m - move_m / 2.0
    shortest_s = _shortest_s(case, start_m, move_m)
    if case.valve.is_immediate or not math.isfinite(shortest_s):
        return Durations(shortest_s, shortest_s + case.period_s)
    return Durations(shortest_s, max(_of_the_law_s(case, start_m, move_m), shortest_s))


def _of_the_law_s(case: Case, start_m: float, move_m: float) -> float:
    """Return how long the law's move takes behind a lag."""
    rollout, target_m, belief = case.rollout(), start_m + move_m, case.belief
    rests = _at_rest(rollout, start_m)
    near_m, closely_m = SETTLED_OF_SPAN * case.valve.span_m, _PLANNED_OF_SPAN * case.valve.span_m
    task = _task(case, rests.pressure, start_m, target_m)
    plan = slip_plan(case.plant(), belief.numbers.mean, 0.0, task, closely_m)
    level_ma = case.limits.clipped(belief.landing_ma(target_m, 1.0))
    currents, settled = (*plan.currents, plan.task.hold_ma) if plan else (level_ma,), 1
    for sample, moving in enumerate(rollout.path(rests, currents), start=1):
        if abs(moving.stem.position_m - target_m) > near_m:
            settled = sample + 1
        arrived = sample >= len(currents) and abs(moving.pressure.pressure_ma - currents[-1]) < ARRIVED_MA
        if (moving.stem.stuck and arrived) or sample * case.period_s > _LONGEST_S:
            break
    return settled * case.period_s


def _shortest_s(case: Case, start_m: float, move_m: float) -> float:
    lag_s = max(case.valve.actuator.fill_time_constant_s, case.valve.actuator.converter_time_constant_s)
    step_s = max(_SHORTEST_STEP_S, lag_s / _STEPS_OF_LAG)
    rollout, target_m = case.rollout(step_s), start_m + move_m
    low_s, high_s = 0.0, step_s
    while _thrown(case, rollout, step_s, start_m, target_m, high_s)[0] < target_m:
        low_s, high_s = high_s, 2.0 * high_s
        if high_s > _LONGEST_S:
            return math.inf
    for _ in range(_HALVINGS):
        middle_s = (low_s + high_s) / 2.0
        if _thrown(case, rollout, step_s, start_m, target_m, middle_s)[0] < target_m:
            low_s = middle_s
        else:
            high_s = middle_s
    return _thrown(case, rollout, step_s, start_m, target_m, high_s)[1]


def _thrown(
    case: Case, rollout: Rollout, step_s: float, start_m: float, target_m: float, until_s: float
) -> tuple[float, float]:
    """Return where a stem stops that is pushed `until_s` and then braked with all current, and when it settles."""
    whole = int(until_s / step_s)
    part = until_s / step_s - whole
    both_ma = part * case.high_ma + (1.0 - part) * case.low_ma  # the sample in which the current changes
    near_m, is_free, settled = SETTLED_OF_SPAN * case.valve.span_m, False, 0
    late = whole + rollout.pressure.waiting // rollout.steps + 1
    currents = (case.high_ma,) * whole + (both_ma, case.low_ma)
    for sample, moving in enumerate(rollout.path(_at_rest(rollout, start_m), currents), start=1):
        stem = moving.stem
        is_free = is_free or stem.position_m != start_m
        if abs(stem.position_m - target_m) > near_m:
            settled = sample
        if stem.stuck and (is_free or sample > late):
            break
    return stem.position_m, settled * step_s


def _task(case: Case, pressure: PressureState, start_m: float, target_m: float) -> Task:
    """Return the law's task of a move."""
    return task_of(case.belief, case.valve.actuator, case.limits, pressure, start_m, target_m, case.period_s)


def _at_rest(rollout: Rollout, x: float) -> Moving:
    """Return a stem that rests in the middle of its stick band."""
    return Moving(rollout.pressure.at_rest(rollout.numbers.balance_ma(x)), StemState(x, 0.0, True, 1.0))


def _freed(rollout: Rollout, x: float, direction: float) -> Moving:
    """Return a stem that has just been freed by a pressure that does not change."""
    freeing_ma = rollout.numbers.balance_ma(x) + direction * rollout.numbers.static_ma
    return Moving(rollout.pressure.at_rest(freeing_ma), StemState(x, 0.0, False, direction))
