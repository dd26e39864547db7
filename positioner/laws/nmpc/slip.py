"""A move whose pressure rises as fast as it can and falls again in time for the stem to stop at its target. Pure.

The current stays at its limit, then at the other one until the pressure is in the middle of the stick band of the
target, and then there. How long it stays at the first one decides where the stem stops, and is found by bisection on
the rollout (`valve.rollout`). While the stem follows the pressure this is the time-optimal move, and it may be shorter
than the slip jump. Its stop depends on lag and viscous friction, too, and its σ says how sure it is.

On the way the readings say when to brake (`steered`): a move of which enough is left when its stem is seen to move
needs no certain friction.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.belief import DEAD_TIME, LAG, LEAST_LAG_S, SPRING, lag_s_of
from positioner.laws.nmpc.stop import Stop, Task, beyond_m, stop_of
from positioner.values import dataclass, replace
from positioner.valve.rollout import Numbers

if TYPE_CHECKING:
    from positioner.laws.nmpc.belief import ValveBelief
    from positioner.laws.nmpc.move import Limits
    from positioner.laws.nmpc.programme import StopPlanner
    from positioner.laws.nmpc.track import Track
    from positioner.valve.actuator import ActuatorParameters
    from positioner.valve.pressure import PressureState
    from positioner.valve.rollout import Moving, Plant, Rollout

_DIFFERENCES = (0.01, 0.02, 0.02, 0.02, 0.05, 0.05, 0.0005)
"""Steps of the derivatives by k (relative), c, f_c, f_s (mA), ln τ, ln ν and T_d (s): σ of what is known well."""
_BISECTIONS = 18
"""Of eight lags to 0.03 ms at a lag of 1 s."""
_DEPTH = 0.5
"""Of a lag: how long the current may take from the brake's level back to where the stem is held."""
_LEAST_LAG = 0.02
"""Of a sample: a lag that is none."""
_LAGS = 8.0
"""The pressure is at the limit after so many lags."""
_CLOSE = 0.2
"""Of the distance within which a stop counts as at the target: nearer than this, no better one is looked for."""
_SHORTER = 0.6
"""σ that the largest value of a random walk is expected to be, if σ is that of its last one, is √(2/π) = 0.8
(reflection principle, Lévy 1948). With 0.6 the stops of moves are about their target where 2 % of the friction
is not known (`test_nmpc_braked`)."""
_LATER = 4
"""The brake comes at the latest a quarter later than planned: friction is seldom more than that beyond the believed."""
_ENDS = 2
"""A slip is over after twice the time until its latest brake: braking takes no longer than the boost before it."""


def task_of(
    belief: ValveBelief,
    actuator: ActuatorParameters,
    limits: Limits,
    pressure: PressureState,
    start_m: float,
    target_m: float,
    period_s: float,
    before_ma: float = 0.0,
    step_ma: float = math.inf,
) -> Task:
    """Return the task of a move.

    Args:
        belief: of the valve.
        actuator: as believed.
        limits: of the current.
        pressure: at the start.
        start_m: where the stem rests.
        target_m: where it is to stop.
        period_s: of a sample.
        before_ma: the current of the sample before.
        step_ma: its largest change from sample to sample.
    """
    upwards = target_m > start_m
    rises_s, falls_s = (max(actuator.lag_s(fills=fills), _LEAST_LAG * period_s) for fills in (upwards, not upwards))
    boost_ma, brake_ma = limits.high_ma, limits.low_ma
    if not upwards:
        boost_ma, brake_ma = brake_ma, boost_ma
    hold_ma = limits.clipped(belief.balance_ma(target_m))
    depth_ma = _DEPTH * step_ma * falls_s / period_s
    brake_ma = min(max(brake_ma, hold_ma - depth_ma), hold_ma + depth_ma)
    return Task(
        pressure, start_m, target_m, boost_ma, brake_ma, hold_ma, rises_s, falls_s, period_s, before_ma, step_ma
    )


@dataclass(frozen=True, slots=True)
class SlipPlan:
    """A braked move: its stop, and how that depends on k, c, f_c, f_s, ln τ, ln ν and T_d.

    rollout: by which it was planned, and is steered. currents: of the samples, at first as planned; from the brake on,
    those that the readings have led to. boosted: samples before the brake. by_reading: nothing but readings says when
    to brake. is_braking: the brake has begun; is_over: it is steered no longer, since the stem has stopped, or was
    braked before it was seen to move. solved: quadratic programmes until now.
    """

    task: Task
    rollout: Rollout
    currents: tuple[float, ...]
    boosted: int
    stop: Stop
    line: tuple[float, ...]
    by_reading: bool = False
    is_braking: bool = False
    is_over: bool = False
    solved: int = 0

    @property
    def latest(self) -> int:
        """The sample at which the brake comes at the latest."""
        later = self.boosted + self.boosted // _LATER + 2
        return later + self.stop.freed if self.by_reading else later

    @property
    def ends(self) -> int:
        """The sample from which on a stop is no longer steered: what is tracked then is no stem that slides."""
        return _ENDS * self.latest


def numbers_of(theta: tuple[float, ...], local_ma: float = 0.0) -> Numbers:
    """Return the numbers of θ = (k, c, f_c, f_s, ln τ, ln ν, T_d); local_ma: what the friction near the target adds."""
    spring, offset, sliding, static, _, viscous, dead_time_s = theta
    return Numbers(spring, offset + local_ma, sliding, static, lag_s_of(theta), dead_time_s, math.exp(viscous))


def both_sides(theta: tuple[float, ...], place: int) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
    """Return how far apart two steps of one of the numbers are, and θ with the one up and the one down."""
    here, change, least = theta[place], _DIFFERENCES[place], -math.inf
    if place == SPRING:
        change *= here
    elif place == LAG:
        least = math.log(LEAST_LAG_S)
    elif place == DEAD_TIME:
        least = 0.0
    before, after, lower = theta[:place], theta[place + 1 :], max(here - change, least)
    return here + change - lower, (*before, here + change, *after), (*before, lower, *after)


def slip_plan(plant: Plant, theta: tuple[float, ...], local_ma: float, task: Task, within_m: float) -> SlipPlan | None:
    """Return the move that stops at its target, None where no move stops within `within_m` of it.

    Args:
        plant: the configured valve.
        theta: k, c, f_c, f_s, ln τ, ln ν and T_d.
        local_ma: what the friction near the target adds to c.
        task: the move.
        within_m: how far from the target it may stop.
    """
    rollout = plant.rollout(numbers_of(theta, local_ma))
    ramp = abs(task.boost_ma - task.before_ma) / task.step_ma
    swing_s = 2.0 * math.pi * math.sqrt(plant.mass / theta[0])
    low_s, high_s = 0.0, swing_s + _LAGS * task.rises_s + (4.0 + ramp) * task.period_s
    best, boost_of_s = Stop(math.inf, -1, False, 0.0), 0.0
    for _ in range(_BISECTIONS):
        boost_s = 0.5 * (low_s + high_s)
        stop = stop_of(rollout, task, task.currents(boost_s))
        gone_m = beyond_m(stop, task)
        if gone_m < 0.0:
            low_s = boost_s
        else:
            high_s = boost_s
        if abs(gone_m) < abs(best.position_m - task.target_m):
            best, boost_of_s = stop, boost_s
            if abs(gone_m) < _CLOSE * within_m:
                break
    if not best.is_held or abs(best.position_m - task.target_m) > within_m:
        return None
    currents = task.currents(boost_of_s)
    line: list[float] = []
    for place in range(len(theta)):
        apart, higher, lower = both_sides(theta, place)
        up, down = (stop_of(plant.rollout(numbers_of(one, local_ma)), task, currents) for one in (higher, lower))
        line.append((up.position_m - down.position_m) / apart)
    return SlipPlan(task, rollout, currents, int(boost_of_s / task.period_s), best, tuple(line))


def shortest_m(rollout: Rollout, task: Task, seen: int) -> float:
    """Return the way of a stem that is braked `seen` samples after it was freed; inf if it is not freed."""
    whole = stop_of(
        rollout, task, (task.boost_ma,) * int(_LAGS * task.rises_s / task.period_s + 3.0 + 16.0 / task.step_ma)
    )
    if whole.freed < 0:
        return math.inf
    stop = stop_of(rollout, task, task.currents((whole.freed + seen) * task.period_s))
    return abs(stop.position_m - task.start_m)


def steered(plan: SlipPlan, track: Track, sent: int, before_ma: float, planner: StopPlanner) -> SlipPlan | None:
    """Return the plan from here on, for a stem that is tracked so after `sent` samples; None: another boosted sample.

    A brake can be taken back in part, but it cannot be made stronger: a stop that later readings put beyond the target
    stays there, and one that they put short of it is steered on. Aimed at the target it would come to rest beyond it by
    what is expected of the largest of these changes. So it is aimed shorter by that.
    """
    moving = track.moving
    task, rollout = replace(plan.task, pressure=moving.pressure, before_ma=before_ma), plan.rollout
    if not moving.stem.stuck:
        shown_m = math.sqrt(track.shown_m2(rollout, task.currents(0.0), task.hold_ma))
        task = replace(task, target_m=task.target_m - task.direction * _SHORTER * shown_m)
    longer = stop_of(rollout, task, task.currents(task.period_s), moving)
    if beyond_m(longer, task) < 0.0 and sent < plan.latest:
        return None
    currents, solved = task.currents(0.0), 0
    stop = stop_of(rollout, task, currents, moving)
    if moving.stem.stuck or beyond_m(stop, task) <= 0.0:
        later = (task.target_m - stop.position_m) / (longer.position_m - stop.position_m or math.inf)
        planned = task.currents(min(max(later, 0.0), 1.0) * task.period_s)
        currents, stop, solved = planner.placed(rollout, task, moving, planned)
    stop, solved = replace(plan.stop, position_m=stop.position_m), plan.solved + solved
    return replace(plan, currents=currents, stop=stop, solved=solved, is_braking=True)


def over(plan: SlipPlan, moving: Moving) -> SlipPlan:
    """Return the plan of a stem that has stopped: the pressure goes to where it holds the stem."""
    task = replace(plan.task, pressure=moving.pressure)
    return replace(plan, currents=task.currents(0.0), is_over=True)
