"""What a cycle sends: the command that the guard admits, and the status when it is due. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.cycle.alarms import message_of, worst_of
from positioner.cycle.sent import NONE_SENT, SentCommand
from positioner.guard.supervisor import admit
from positioner.values import replace
from positioner.wire.loop_current import same_signal
from positioner.wire.messages import CanFrame, CurrentCommand, Mode, Motion, PositionerStatus
from positioner.wire.rounding import inside

if TYPE_CHECKING:
    from positioner.cycle.link import Reading
    from positioner.cycle.sent import OutputState
    from positioner.cycle.state import CycleState, Setup
    from positioner.laws.law import Decision

_NS = 1_000_000_000
STATUS_PERIOD_NS = _NS // 10


def send(
    setup: Setup, state: CycleState, decision: Decision | None, reading: Reading | None, now_ns: int
) -> list[CanFrame]:
    """Return the frames to send, which the state notes: the command; status, count and alarms when due."""
    state.output, frames = _command(setup, state, decision, reading, now_ns)
    output = state.output
    due = output.status_ns is None or now_ns - output.status_ns >= STATUS_PERIOD_NS
    if not due or (not state.guard.arming.ever_armed and state.guard.last.foreign_ns is not None):
        return frames  # beside another controller, one that was never armed leaves the status to it
    state.counters, count = state.counters.next_message()
    alarms = message_of(state.alarms) if state.alarmed else None
    messages = (_status(state), count, alarms)
    frames += [setup.codec.encode(each, output.status_counter) for each in messages if each is not None]
    state.output = replace(output, status_counter=output.status_counter + 1, status_ns=now_ns)
    return frames


def _command(
    setup: Setup, state: CycleState, decision: Decision | None, reading: Reading | None, now_ns: int
) -> tuple[OutputState, list[CanFrame]]:
    """Return the output after this cycle, and the command frame, if the guard lets one be sent."""
    output, guard = state.output, state.guard
    here_m = reading.position_m if reading else state.control.setpoint_m
    last_ma, elapsed_s = _last(setup, output, here_m, now_ns)
    wanted_ma = decision.current_ma if decision else guard.manual_ma
    current_ma = admit(setup.guard, guard, wanted_ma, last_ma, elapsed_s)
    if current_ma is None:
        paused_ma = output.paused_ma if output.last_ma is None else output.last_ma
        return replace(output, sent=NONE_SENT, paused_ma=paused_ma), []
    current_ma = inside(setup.codec.field(CurrentCommand, "current_ma"), current_ma, *_limits_ma(setup, guard.mode))
    message = CurrentCommand(
        current_ma=current_ma,
        position_counter=state.link.feedback.counter,
        setpoint_counter=state.link.setpoint.counter,
        mode=guard.mode,
        motion=decision.motion if decision else Motion.NONE,
    )
    frame = setup.codec.encode(message, output.command_counter)
    modulus = setup.codec.by_kind[CurrentCommand].counter_modulus
    sent = output.sent.with_newest(SentCommand(output.command_counter % modulus, current_ma))
    return replace(output, sent=sent, command_counter=output.command_counter + 1, command_ns=now_ns), [frame]


def _limits_ma(setup: Setup, mode: Mode) -> tuple[float, float]:
    """Return the limits in mA within which a current is rounded to the steps of its signal."""
    if mode is Mode.FAILSAFE:
        return same_signal(setup.guard.failsafe_ma(setup.guard.current_low_ma))
    return setup.guard.current_low_ma, setup.guard.current_high_ma


def _last(setup: Setup, output: OutputState, here_m: float, now_ns: int) -> tuple[float, float]:
    """Return the current in mA that the next one follows, and for how long it has acted in s.

    After a pause, where the rate is limited, this is the last command before the pause. Otherwise control begins at the
    current that balances the spring.
    """
    elapsed_s = (now_ns - output.command_ns) / _NS
    if output.last_ma is not None:
        return output.last_ma, elapsed_s
    if output.paused_ma is not None and setup.guard.max_rate_ma_per_s > 0.0:
        return output.paused_ma, elapsed_s
    return setup.valve.balance_current_ma(here_m), setup.period_s


def _status(state: CycleState) -> PositionerStatus:
    guard, counters = state.guard, state.counters
    return PositionerStatus(
        mode=guard.mode,
        cause=guard.cause,
        health=max(guard.health(table_saved=state.table_saved), worst_of(state.alarms)),
        armed=guard.arming.armed,
        table_saved=state.table_saved,
        fallback_count=counters.fallbacks % 256,
        rejected_count=counters.refused_frames % 256,
        learned_count=counters.learned % 256,
    )
