"""What ends a stroke test before its time: the first criterion that holds. Pure.

A disarming, another mode and a trip of the guard come before all of these: then the law has no say any more.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.commissioning.stroke.memory import Cause, Phase, Stop

if TYPE_CHECKING:
    from positioner.commissioning.stroke.memory import StrokeMemory
    from positioner.commissioning.stroke.plan import Plan
    from positioner.commissioning.stroke.settings import StrokeSettings

_STANDS_S = 0.3
"""A stem that has moved stands still again when it has not left its place for so long."""
_SETTLES_S = 0.3
"""So long after a breakaway, lags apart, the stem is on its course."""
_MM = 1e3


def first_broken(
    settings: StrokeSettings, memory: StrokeMemory, plan: Plan, missing_s: float
) -> Stop | None:
    """Return why the test must end now, None where it may go on.

    missing_s: for how long readings were missing before this one, 0 where they were not.
    """
    gone_m = plan.gone_m(memory.smooth_m)
    at_mm = memory.smooth_m * _MM

    def stop(cause: Cause, why: str) -> Stop:
        return Stop(cause, why, memory.current_ma, memory.smooth_m, memory.time_s)

    if missing_s > 0.0:
        return stop(Cause.FEEDBACK, f"no reading was accepted for {missing_s * _MM:.0f} ms")
    if gone_m > plan.furthest_m:
        most_mm = plan.furthest_m * _MM
        return stop(Cause.BEYOND, f"the stem is {gone_m * _MM:.1f} mm from its start, the limit is {most_mm:.1f} mm")
    moved = memory.breakaway
    pushes = memory.phase in {Phase.OUT, Phase.BACK}
    stands = moved is None or (memory.still_s >= _STANDS_S and memory.time_s - moved.time_s >= _STANDS_S)
    place_m = memory.from_m if moved is None else memory.still_m
    push_ma = abs(memory.current_ma - plan.balance_ma(place_m))
    if pushes and stands and push_ma > settings.stuck_of_reference * plan.static_ma:
        way = "to move" if moved is None else "again"
        why = (
            f"the stem is stuck at {at_mm:.1f} mm: {push_ma:.2f} mA beyond the middle of its stick band, "
            f"{push_ma / plan.static_ma:.2f} times its static friction, do not bring it {way}"
        )
        return stop(Cause.STUCK, why)
    if pushes and moved is None and memory.phase_s > settings.breakaway_s:
        why = f"no motion for {memory.phase_s:.1f} s, up to {push_ma:.2f} mA beyond the middle of the stick band"
        return stop(Cause.NO_MOTION, why)
    off_m = off_course_m(plan, memory)
    if off_m > 0.0:
        most_mm = plan.tolerance_m * _MM
        return stop(Cause.OFF_COURSE, f"the stem is at {at_mm:.1f} mm, more than {most_mm:.2f} mm from its course")
    if memory.time_s > settings.total_s:
        return stop(Cause.TOO_LONG, f"the test has not ended after {memory.time_s:.1f} s, in: {memory.phase}")
    return None


def off_course_m(plan: Plan, memory: StrokeMemory) -> float:
    """Return how far in m the stem is beyond the tolerance of its course; 0 or less while it keeps to it."""
    gone_m, tolerance_m = plan.gone_m(memory.smooth_m), plan.tolerance_m
    if not plan.steadily:
        tolerance_m += plan.jump_m
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
