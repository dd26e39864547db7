"""What ends a stroke test before its time: the first criterion that holds. Pure.

Before all of these come what the guard decides (a disarming, another mode, a trip, missing feedback), and a new
setpoint.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.commissioning.stroke.memory import Cause, Phase, Stop

if TYPE_CHECKING:
    from positioner.commissioning.stroke.memory import StrokeMemory
    from positioner.commissioning.stroke.plan import Plan
    from positioner.commissioning.stroke.settings import StrokeSettings

_PUSHES = frozenset({Phase.OUT, Phase.BACK, Phase.AWAY, Phase.RETURN})
_STANDS_S = 0.3
"""A stem that has moved stands still again when it has not left its place for so long."""
_SETTLES_S = 0.3
"""So long after a breakaway, lags apart, the stem is on its course."""
_MM = 1e3


def first_broken(settings: StrokeSettings, memory: StrokeMemory, plan: Plan) -> Stop | None:
    """Return why the test must end now, None where it may go on."""
    gone_m = plan.gone_m(memory.smooth_m)
    broken: tuple[Cause, str] | None = None
    if gone_m > plan.furthest_m:
        most_mm = plan.furthest_m * _MM
        broken = Cause.BEYOND, f"the stem is {gone_m * _MM:.1f} mm from its start, the limit is {most_mm:.1f} mm"
    elif memory.phase in _PUSHES:
        broken = _stuck(settings, memory, plan)
    if broken is None and off_course_m(plan, memory) > 0.0:
        at_mm, most_mm = memory.smooth_m * _MM, (plan.tolerance_m + plan.jump_m) * _MM
        broken = Cause.OFF_COURSE, f"the stem is at {at_mm:.1f} mm, more than {most_mm:.2f} mm from its course"
    if broken is None and memory.time_s > settings.total_s:
        broken = Cause.TOO_LONG, f"the test has not ended after {memory.time_s:.1f} s, in: {memory.phase}"
    return Stop(*broken, memory.current_ma, memory.smooth_m, memory.time_s) if broken else None


def _stuck(settings: StrokeSettings, memory: StrokeMemory, plan: Plan) -> tuple[Cause, str] | None:
    """Return why a pushed stem counts as stuck, None where it moves, or may still begin to."""
    moved = memory.breakaway
    if moved and (memory.still_s < _STANDS_S or memory.time_s - moved.time_s < _STANDS_S):
        return None
    place_m = memory.still_m if moved else memory.from_m
    push_ma = abs(memory.current_ma - plan.balance_ma(place_m))
    if push_ma > settings.stuck_of_reference * plan.static_ma:
        why = (
            f"stuck at {place_m * _MM:.1f} mm: {push_ma:.2f} mA beyond the middle of the stick band, "
            f"{push_ma / plan.static_ma:.2f} times the static friction, do not move the stem"
        )
        return Cause.STUCK, why
    if moved is None and memory.phase_s > settings.breakaway_s:
        why = f"no motion for {memory.phase_s:.1f} s, up to {push_ma:.2f} mA beyond the middle of the stick band"
        return Cause.NO_MOTION, why
    return None


def off_course_m(plan: Plan, memory: StrokeMemory) -> float:
    """Return how far in m the stem is beyond the tolerance of its course; 0 or less while it keeps to it.

    A stem may stick again on its way, and jump: its natural jump is added to the tolerance.
    """
    gone_m, tolerance_m = plan.gone_m(memory.smooth_m), plan.tolerance_m + plan.jump_m
    moved = memory.breakaway
    match memory.phase:
        case Phase.OUT | Phase.BACK if moved is None:
            return abs(memory.smooth_m - memory.from_m) - tolerance_m
        case Phase.OUT | Phase.BACK:
            assert moved is not None  # noqa: S101 - the case before
            since_s = memory.time_s - moved.time_s
            if since_s < _SETTLES_S + 3.0 * plan.lag_s:
                return 0.0
            jump_m = plan.jump_m * moved.push_ma / plan.static_ma
            slid_m = jump_m + plan.speed_m_per_s * since_s
            course_m = slid_m if memory.phase is Phase.OUT else plan.gone_m(memory.from_m) - slid_m
            return abs(gone_m - min(max(course_m, 0.0), plan.aim_m)) - tolerance_m
        case Phase.COAST | Phase.PAUSE:
            return abs(gone_m - plan.aim_m) - tolerance_m
        case Phase.SETTLE:
            return abs(gone_m) - tolerance_m
        case _:
            return 0.0
