"""The way of the stem back to its start, in a stroke test and after one that was ended. Pure.

The stem slides onto the start from the side of the stroke, and the friction stops it there. Where it is too near for
that, or beyond the start, it first goes away to that side, farther than its natural jump.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.commissioning.stroke.memory import Moved, Phase
from positioner.values import replace

if TYPE_CHECKING:
    from positioner.commissioning.procedure import ProcedureLimits
    from positioner.commissioning.stroke.memory import StrokeMemory
    from positioner.commissioning.stroke.plan import Plan
    from positioner.commissioning.stroke.settings import StrokeSettings
    from positioner.laws.law import Observation

_RATES = 2.0
"""A stem that is only brought back is freed by a ramp so many times as fast."""
_NEAR_OF_SPAN = 0.004
_JUMPS = 1.3
_MOST_TRIES = 4
_SETTLE_S = 1.0
_GIVE_UP_S = 3.0


def freed(memory: StrokeMemory, plan: Plan) -> StrokeMemory:
    """Return the memory, with the breakaway in it as soon as the stem has moved."""
    if memory.breakaway or abs(memory.smooth_m - memory.from_m) <= plan.seen_m:
        return memory
    push_ma = abs(memory.current_ma - plan.balance_ma(memory.from_m))
    moved = Moved(memory.phase, memory.samples - 1, push_ma, memory.time_s)
    return replace(memory, moved=(*memory.moved, moved))


def back(
    memory: StrokeMemory, plan: Plan, limits: ProcedureLimits, settings: StrokeSettings, observation: Observation
) -> StrokeMemory:
    """Return the memory with the current that takes the stem to its start, or away from it."""
    away = memory.phase is Phase.AWAY
    memory = freed(memory, plan)
    gone_m, way = plan.gone_m(memory.smooth_m), plan.way if away else -plan.way
    if away and gone_m >= _JUMPS * plan.jump_m + memory.tries * _NEAR_OF_SPAN * limits.span_m:
        return replace(memory.then(Phase.RETURN), current_ma=plan.balance_ma(memory.smooth_m))
    end_ma = limits.current_low_ma if way < 0.0 else limits.current_high_ma
    fails = memory.current_ma == end_ma and memory.still_s > _GIVE_UP_S + 3.0 * plan.lag_s
    if fails or (not away and memory.breakaway and gone_m <= plan.late_m):
        return replace(memory.then(Phase.SETTLE), current_ma=plan.balance_ma(plan.start_m))
    rate = plan.rate_ma_per_s
    if memory.breakaway is None:
        rate = settings.rate_ma_per_s * (1.0 if memory.phase is Phase.BACK else _RATES)
    current_ma = memory.current_ma + way * rate * observation.elapsed_s
    return replace(memory, current_ma=min(max(current_ma, limits.current_low_ma), limits.current_high_ma))


def settled(memory: StrokeMemory, plan: Plan, limits: ProcedureLimits, observation: Observation) -> StrokeMemory:
    """Hold the stem; then end the test, or bring the stem nearer to the start."""
    settle_s = _SETTLE_S + 3.0 * plan.lag_s
    if 2.0 * memory.phase_s >= settle_s:
        memory = replace(memory, mean=memory.mean.add(observation.measured_m))
    if memory.phase_s < settle_s:
        return memory
    gone_m = plan.gone_m(memory.mean.mean_m)
    if abs(gone_m) <= _NEAR_OF_SPAN * limits.span_m or memory.tries == _MOST_TRIES:
        return memory.then(Phase.ENDED)
    memory = replace(memory, tries=memory.tries + 1)
    begins = Phase.RETURN if gone_m >= _JUMPS * plan.jump_m else Phase.AWAY
    here_m = memory.mean.mean_m
    return replace(memory.then(begins), from_m=here_m, still_m=here_m, current_ma=plan.balance_ma(here_m))
