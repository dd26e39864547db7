"""How far the smallest push takes a stem, and how long a move lasts at best, and with the law `nmpc`. Pure.

The shortest move: all current in one direction, then all in the other, so that the stem stops at its target. The law's
behind a pressure that lags is a braked move (`laws.quasi_static.slip`); where none is made, as behind a slew limit
alone, it commands the level at which the stem stops. Without lag it answers a new setpoint one period later, and is as
short as it can be.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.laws.quasi_static.belief import belief_of
from positioner.laws.quasi_static.slip import Task, slip_plan, stop_of
from positioner.values import replace
from positioner.valve.rollout import Moving
from positioner.valve.state import StemState

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from positioner.reach.case import Case
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


def natural_jump_m(case: Case) -> float:
    """Return (F_s - F_c)/K in m: the slip under a pressure that is held."""
    return case.numbers.jump_m


def slip_s(case: Case) -> float:
    """Return after how long in s a slip is nearly over, under the pressure that freed the stem."""
    rollout, moving = case.rollout(_SLIP_STEP_S), _freed(case, 1.0)
    over_m, current_ma, t = case.middle_m + _NEARLY * natural_jump_m(case), moving.pressure.pressure_ma, 0.0
    while not moving.stem.stuck and moving.stem.position_m < over_m and t < _LONGEST_S:
        moving = rollout.after(moving, current_ma)
        t += _SLIP_STEP_S
    return t


def smallest_push_m(case: Case, direction: float) -> float:
    """Return how far a stem moves that is freed in `direction` (±1) for one period and the dead time, then braked."""
    rollout, moving = case.rollout(), _freed(case, direction)
    freeing_ma, hold_ma = moving.pressure.pressure_ma, rollout.numbers.balance_ma(case.middle_m)
    moving = rollout.after(moving, freeing_ma)
    if moving.stem.stuck:
        return direction * (moving.stem.position_m - case.middle_m)
    task = _task(case, moving.stem.position_m, case.middle_m + direction, freeing_ma)
    task = replace(task, pressure=moving.pressure, hold_ma=hold_ma)
    brakes = task.currents(0.0) if min(task.rises_s, task.falls_s) > 0.0 else (hold_ma,)
    stop = stop_of(rollout, task, brakes, moving)
    return direction * (stop.position_m - case.middle_m)


def durations(case: Case, move_m: float) -> Durations:
    """Return the durations of an opening by `move_m` around the middle; infinity where the current is too weak."""
    start_m = case.middle_m - move_m / 2.0
    shortest_s = _shortest_s(case, start_m, move_m)
    if case.valve.is_immediate or not math.isfinite(shortest_s):
        return Durations(shortest_s, shortest_s + case.period_s)
    return Durations(shortest_s, max(_of_the_law_s(case, start_m, move_m), shortest_s))


def _freed(case: Case, direction: float) -> Moving:
    """Return a stem in the middle that has just been freed by a pressure that does not change."""
    rollout = case.rollout()
    numbers, x = rollout.numbers, case.middle_m
    freeing_ma = numbers.balance_ma(x) + direction * numbers.static_ma
    return Moving(rollout.pressure.at_rest(freeing_ma), StemState(x, 0.0, False, direction))


def _task(case: Case, start_m: float, target_m: float, pressure_ma: float) -> Task:
    """Return the law's task: from this place and pressure to a target."""
    rollout, actuator, upwards = case.rollout(), case.valve.actuator, target_m > start_m
    rises_s, falls_s = (actuator.lag_s(fills=fills) for fills in (upwards, not upwards))
    ends_ma = (case.high_ma, case.low_ma) if upwards else (case.low_ma, case.high_ma)
    hold_ma = min(max(rollout.numbers.balance_ma(target_m), case.low_ma), case.high_ma)
    pressure = rollout.pressure.at_rest(pressure_ma)
    return Task(pressure, start_m, target_m, *ends_ma, hold_ma, rises_s, falls_s, case.period_s)


def _of_the_law_s(case: Case, start_m: float, move_m: float) -> float:
    """Return how long the law's move takes behind a lag."""
    rollout, target_m, belief = case.rollout(), start_m + move_m, belief_of(case.valve)
    task, plan = _task(case, start_m, target_m, rollout.numbers.balance_ma(start_m)), None
    near_m, closely_m = SETTLED_OF_SPAN * case.valve.span_m, _PLANNED_OF_SPAN * case.valve.span_m
    if min(task.rises_s, task.falls_s) > 0.0:
        plan = slip_plan(case.plant(), belief.numbers.mean, 0.0, task, closely_m)
    level_ma = min(max(belief.landing_ma(target_m, 1.0), case.low_ma), case.high_ma)
    currents, settled = (*plan.currents, task.hold_ma) if plan else (level_ma,), 1
    for sample, moving in enumerate(_path(rollout, start_m, currents), start=1):
        if abs(moving.stem.position_m - target_m) > near_m:
            settled = sample + 1
        arrived = sample >= len(currents) and abs(moving.pressure.pressure_ma - currents[-1]) < _ARRIVED_MA
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
    for sample, moving in enumerate(_path(rollout, start_m, (case.high_ma,) * whole + (both_ma, case.low_ma)), start=1):
        stem = moving.stem
        is_free = is_free or stem.position_m != start_m
        if abs(stem.position_m - target_m) > near_m:
            settled = sample
        if stem.stuck and (is_free or sample > late):
            break
    return stem.position_m, settled * step_s


def _path(rollout: Rollout, start_m: float, currents: Sequence[float]) -> Iterator[Moving]:
    """Yield the motion after each sample of a stem that rests in the middle of its band; the last current stays."""
    rests_ma = rollout.numbers.balance_ma(start_m)
    moving = Moving(rollout.pressure.at_rest(rests_ma), StemState(start_m, 0.0, True, 1.0))
    for sample in itertools.count():
        moving = rollout.after(moving, currents[min(sample, len(currents) - 1)])
        yield moving


_ARRIVED_MA = 0.05
