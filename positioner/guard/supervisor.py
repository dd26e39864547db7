"""The guard: modes, stale data, and the last word on the current. Pure.

    INIT -> READY -> ACTIVE <-> HOLD -> FAILSAFE (latched until it is armed again)
                     ACTIVE, HOLD <-> MANUAL

The guard knows nothing of the law but its number: whatever it is, what leaves is inside the loop's limits.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.guard.arming import arm
from positioner.guard.manual import update_manual
from positioner.guard.stall import failsafe_ns, hold_ns
from positioner.guard.state import GuardInput, GuardState
from positioner.wire.messages import Cause, Mode

if TYPE_CHECKING:
    from positioner.guard.settings import GuardSettings

_NS = 1_000_000_000
_FOREIGN_MEMORY_NS = _NS
"""A foreign command is held against arming, and kept in the status, for one second."""


def supervise(
    settings: GuardSettings, state: GuardState, guard_input: GuardInput, period_s: float, now_ns: int
) -> GuardState:
    """Return the guard's state after `guard_input`, at `now_ns`."""
    foreign_ns = now_ns if guard_input.foreign_command else state.foreign_ns
    if foreign_ns is not None and now_ns - foreign_ns > _FOREIGN_MEMORY_NS:
        foreign_ns = None
    manual = update_manual(state.manual, guard_input.manual, now_ns)
    setpoint_ns = now_ns - guard_input.setpoint_age_ns if guard_input.setpoint else state.setpoint_ns
    if manual.received_ns == now_ns:
        setpoint_ns = now_ns
    state = GuardState(
        state.mode,
        state.cause,
        state.armed,
        state.ever_armed,
        state.request,
        now_ns - guard_input.feedback_age_ns if guard_input.feedback else state.feedback_ns,
        setpoint_ns,
        foreign_ns,
        state.law_failures,
        Cause.FEEDBACK_STALE if guard_input.feedback else guard_input.refused or state.no_feedback,
        state.late_cycles + 1 if guard_input.late else 0,
        manual,
        Cause.SETPOINT_STALE if guard_input.setpoint else guard_input.setpoint_refused or state.no_setpoint,
        guard_input.stall_ns,
        _late_answers(state, guard_input),
        guard_input.idle,
        guard_input.deviation,
        now_ns if guard_input.own_command_returned else state.armed_or_returned_ns,
        guard_input.period_wrong,
    )
    state = arm(settings, state, guard_input, hold_ns(settings, period_s), now_ns)
    mode, cause = _mode(settings, state, period_s, now_ns)
    return replace(state, mode=mode, cause=cause)


def _late_answers(state: GuardState, guard_input: GuardInput) -> int:
    """Return how many answers of the law in a row came after a stall, when it was too late to use them."""
    if not guard_input.answered:
        return state.late_answers
    return state.late_answers + 1 if guard_input.stall_ns else 0


def _mode(settings: GuardSettings, state: GuardState, period_s: float, now_ns: int) -> tuple[Mode, Cause]:
    """Return the first mode and cause whose condition holds: the transition table of DESIGN.md, from the top."""
    if state.feedback_ns is None:
        return Mode.INIT, Cause.WAITING_FOR_FEEDBACK
    silent_periods = (now_ns - state.feedback_ns) / (period_s * _NS)
    by_hand = state.manual.current_ma is not None
    ordered_ns = state.manual.received_ns if by_hand else state.setpoint_ns
    silent_s = math.inf if ordered_ns is None else (now_ns - ordered_ns) / _NS
    foreign = state.foreign_ns is not None
    dead = silent_periods > settings.feedback_failsafe_periods
    rules = (
        (state.mode is Mode.FAILSAFE, Mode.FAILSAFE, state.cause),
        (not state.armed and dead, Mode.INIT, Cause.WAITING_FOR_FEEDBACK),
        (not state.armed and foreign, Mode.READY, Cause.FOREIGN_COMMAND),
        (not state.armed and state.ever_armed, Mode.READY, Cause.DISARMED),
        (not state.armed, Mode.READY, Cause.WAITING_FOR_ARM),
        (state.stall_ns > failsafe_ns(settings, period_s), Mode.FAILSAFE, Cause.STALLED),
        (by_hand and 0.0 < settings.setpoint_failsafe_s < silent_s, Mode.FAILSAFE, Cause.SETPOINT_STALE),
        (by_hand and 0.0 < settings.setpoint_hold_s < silent_s, Mode.MANUAL, Cause.SETPOINT_STALE),
        (by_hand and dead, Mode.MANUAL, state.no_feedback),
        (by_hand and foreign, Mode.MANUAL, Cause.FOREIGN_COMMAND),
        (by_hand, Mode.MANUAL, Cause.MANUAL),
        (dead, Mode.FAILSAFE, state.no_feedback),
        (state.law_failures >= settings.law_failsafe_cycles, Mode.FAILSAFE, Cause.LAW_FAILED),
        (state.late_answers >= settings.law_failsafe_cycles, Mode.FAILSAFE, Cause.LAW_LATE),
        (0.0 < settings.setpoint_failsafe_s < silent_s, Mode.FAILSAFE, state.no_setpoint),
        (state.stall_ns > 0, Mode.HOLD, Cause.STALLED),
        (silent_periods > settings.feedback_hold_periods, Mode.HOLD, state.no_feedback),
        (0.0 < settings.setpoint_hold_s < silent_s, Mode.HOLD, state.no_setpoint),
        (foreign, Mode.ACTIVE, Cause.FOREIGN_COMMAND),
        (state.idle is not None, Mode.ACTIVE, state.idle or Cause.NONE),
        (state.deviation is not Cause.NONE, Mode.ACTIVE, state.deviation),
        (state.period_wrong, Mode.ACTIVE, Cause.PERIOD_WRONG),
        (state.late_cycles >= settings.law_failsafe_cycles, Mode.ACTIVE, Cause.LAW_LATE),
    )
    return next(((mode, cause) for holds, mode, cause in rules if holds), (Mode.ACTIVE, Cause.NONE))


def deadline_ns(settings: GuardSettings, state: GuardState, period_s: float, now_ns: int) -> float | None:
    """Return the instant after which what was computed from fresh feedback may not leave; None where nothing was."""
    if state.feedback_ns is None or is_feedback_stale(settings, state, period_s, now_ns):
        return None
    return state.feedback_ns + hold_ns(settings, period_s)


def is_feedback_stale(settings: GuardSettings, state: GuardState, period_s: float, now_ns: int) -> bool:
    """Return whether the last valid feedback is older than HOLD tolerates."""
    return state.feedback_ns is not None and now_ns - state.feedback_ns > hold_ns(settings, period_s)


def admit(
    settings: GuardSettings, state: GuardState, wanted_ma: float | None, last_ma: float, elapsed_s: float
) -> float | None:
    """Return the current that may leave, in mA, or None for silence.

    wanted_ma is the law's answer, None where it has none; last_ma was commanded `elapsed_s` before. Whatever the law
    says, the result lies within the limits and, where there is one, within the rate.
    """
    if not state.transmits:
        return None
    if state.mode is Mode.FAILSAFE:
        return settings.failsafe_ma(min(max(last_ma, settings.current_low_ma), settings.current_high_ma))
    current = last_ma if wanted_ma is None or not math.isfinite(wanted_ma) else wanted_ma
    if settings.max_rate_ma_per_s > 0.0:
        step = settings.max_rate_ma_per_s * elapsed_s
        current = min(max(current, last_ma - step), last_ma + step)
    return min(max(current, settings.current_low_ma), settings.current_high_ma)
