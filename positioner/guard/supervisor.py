"""The guard: modes, stale data, and the final limit of the current. Pure.

    INIT -> READY -> ACTIVE <-> HOLD -> FAILSAFE (latched until it is armed again)
                     ACTIVE, HOLD <-> MANUAL

The guard sees nothing of the law but the current that it asks for. It limits the current of every law alike.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.guard.arming import arm
from positioner.guard.manual import update_manual
from positioner.guard.stall import failsafe_ns, hold_ns
from positioner.guard.state import NOTHING_WRONG, Conditions, GuardInput, GuardState, LastReceived, LawRecord
from positioner.values import replace
from positioner.wire.messages import Cause, Mode

if TYPE_CHECKING:
    from positioner.guard.manual import Manual
    from positioner.guard.settings import GuardSettings

_NS = 1_000_000_000
_FOREIGN_MEMORY_NS = _NS
"""For so long after a foreign command nothing is armed, and the status reports it."""


def supervise(
    settings: GuardSettings,
    state: GuardState,
    guard_input: GuardInput,
    period_s: float,
    now_ns: int,
    conditions: Conditions = NOTHING_WRONG,
) -> GuardState:
    """Return the guard's state at `now_ns`, from the frames' `guard_input` and the cycle's `conditions`."""
    manual = update_manual(state.manual, guard_input.manual, now_ns)
    returned = guard_input.own_command_returned
    state = GuardState(
        mode=state.mode,
        cause=state.cause,
        arming=replace(state.arming, armed_or_returned_ns=now_ns) if returned else state.arming,
        last=_last_received(state.last, guard_input, manual, now_ns),
        law=_law_record(state.law, conditions),
        manual=manual,
        conditions=conditions,
    )
    state = arm(settings, state, guard_input, hold_ns(settings, period_s), now_ns)
    mode, cause = _mode(settings, state, period_s, now_ns)
    if mode is state.mode and cause is state.cause:
        return state
    return replace(state, mode=mode, cause=cause)


def _last_received(last: LastReceived, guard_input: GuardInput, manual: Manual, now_ns: int) -> LastReceived:
    """Return what was received last; a current by hand is a sign of life of the host, as a setpoint is."""
    feedback_age_ns, setpoint_age_ns = guard_input.feedback_age_ns, guard_input.setpoint_age_ns
    setpoint_ns = last.setpoint_ns if setpoint_age_ns is None else now_ns - setpoint_age_ns
    foreign_ns = now_ns if guard_input.foreign_command else last.foreign_ns
    if foreign_ns is not None and now_ns - foreign_ns > _FOREIGN_MEMORY_NS:
        foreign_ns = None
    return LastReceived(
        feedback_ns=last.feedback_ns if feedback_age_ns is None else now_ns - feedback_age_ns,
        setpoint_ns=now_ns if manual.received_ns == now_ns else setpoint_ns,
        foreign_ns=foreign_ns,
        no_feedback=(
            guard_input.feedback_refused or last.no_feedback if feedback_age_ns is None else Cause.FEEDBACK_STALE
        ),
        no_setpoint=(
            guard_input.setpoint_refused or last.no_setpoint if setpoint_age_ns is None else Cause.SETPOINT_STALE
        ),
    )


def _law_record(law: LawRecord, conditions: Conditions) -> LawRecord:
    """Return the record after another cycle: an answer after a stall was too late to be used."""
    late_answers = law.late_answers
    if conditions.answered:
        late_answers = late_answers + 1 if conditions.stall_ns else 0
    late_cycles = law.late_cycles + 1 if conditions.late else 0
    return LawRecord(failures=law.failures, late_cycles=late_cycles, late_answers=late_answers)


def _mode(  # noqa: C901, PLR0911, PLR0912 - a table, line by line
    settings: GuardSettings, state: GuardState, period_s: float, now_ns: int
) -> tuple[Mode, Cause]:
    """Return the first mode and cause whose condition holds: the transition table of DESIGN.md, from the top."""
    last, law, found = state.last, state.law, state.conditions
    if last.feedback_ns is None:
        return Mode.INIT, Cause.WAITING_FOR_FEEDBACK
    armed, silent_periods = state.arming.armed, (now_ns - last.feedback_ns) / (period_s * _NS)
    by_hand = state.manual.current_ma is not None
    ordered_ns = state.manual.received_ns if by_hand else last.setpoint_ns
    silent_s = math.inf if ordered_ns is None else (now_ns - ordered_ns) / _NS
    foreign = last.foreign_ns is not None
    dead = silent_periods > settings.feedback_failsafe_periods
    if state.mode is Mode.FAILSAFE:
        return Mode.FAILSAFE, state.cause
    if not armed:
        if dead:
            return Mode.INIT, Cause.WAITING_FOR_FEEDBACK
        if foreign:
            return Mode.READY, Cause.FOREIGN_COMMAND
        return Mode.READY, Cause.DISARMED if state.arming.ever_armed else Cause.WAITING_FOR_ARM
    if found.stall_ns > failsafe_ns(settings, period_s):
        return Mode.FAILSAFE, Cause.STALLED
    if by_hand:
        if 0.0 < settings.setpoint_failsafe_s < silent_s:
            return Mode.FAILSAFE, Cause.SETPOINT_STALE
        if 0.0 < settings.setpoint_hold_s < silent_s:
            return Mode.MANUAL, Cause.SETPOINT_STALE
        if dead:
            return Mode.MANUAL, last.no_feedback
        return Mode.MANUAL, Cause.FOREIGN_COMMAND if foreign else Cause.MANUAL
    if dead:
        return Mode.FAILSAFE, last.no_feedback
    if law.failures >= settings.law_failsafe_cycles:
        return Mode.FAILSAFE, Cause.LAW_FAILED
    if law.late_answers >= settings.law_failsafe_cycles:
        return Mode.FAILSAFE, Cause.LAW_LATE
    if 0.0 < settings.setpoint_failsafe_s < silent_s:
        return Mode.FAILSAFE, last.no_setpoint
    if found.stall_ns > 0:
        return Mode.HOLD, Cause.STALLED
    if silent_periods > settings.feedback_hold_periods:
        return Mode.HOLD, last.no_feedback
    if 0.0 < settings.setpoint_hold_s < silent_s:
        return Mode.HOLD, last.no_setpoint
    if foreign:
        return Mode.ACTIVE, Cause.FOREIGN_COMMAND
    if found.no_effect is not None:
        return Mode.ACTIVE, found.no_effect
    if found.hunting:
        return Mode.ACTIVE, Cause.HUNTING
    if found.deviation is not Cause.NONE:
        return Mode.ACTIVE, found.deviation
    if found.no_motion:
        return Mode.ACTIVE, Cause.NO_MOTION
    if found.period_wrong:
        return Mode.ACTIVE, Cause.PERIOD_WRONG
    if found.valve_differs:
        return Mode.ACTIVE, Cause.VALVE_DIFFERS
    if law.late_cycles >= settings.law_failsafe_cycles:
        return Mode.ACTIVE, Cause.LAW_LATE
    return Mode.ACTIVE, Cause.NONE


def deadline_ns(settings: GuardSettings, state: GuardState, period_s: float, now_ns: int) -> float | None:
    """Return the instant in ns until which a command from fresh feedback may be sent; None without such feedback."""
    if state.last.feedback_ns is None or is_feedback_stale(settings, state, period_s, now_ns):
        return None
    return state.last.feedback_ns + hold_ns(settings, period_s)


def is_feedback_stale(settings: GuardSettings, state: GuardState, period_s: float, now_ns: int) -> bool:
    """Return whether the last valid feedback is older than HOLD tolerates."""
    return state.last.feedback_ns is not None and now_ns - state.last.feedback_ns > hold_ns(settings, period_s)


def admit(
    settings: GuardSettings, state: GuardState, wanted_ma: float | None, last_ma: float, elapsed_s: float
) -> float | None:
    """Return the current to be sent in mA, None for silence.

    wanted_ma is the current that the law or a person asks for, None without one; last_ma was commanded `elapsed_s`
    before. Whatever is asked for, the result lies within the limits and, where one is set, within the rate. In FAILSAFE
    it is the current of `failsafe_action`, at once.
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
