"""What a cycle sends: the command that the guard admits, and the status when it is due. Pure."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.cycle.command_effect import SentCommand
from positioner.guard.supervisor import admit
from positioner.wire.loop_current import same_signal
from positioner.wire.messages import CanFrame, CurrentCommand, Mode, Motion, PositionerStatus
from positioner.wire.rounding import inside

if TYPE_CHECKING:
    from positioner.cycle.link import Reading
    from positioner.cycle.state import CycleState, Setup
    from positioner.laws.law import Decision

_NS = 1_000_000_000
STATUS_PERIOD_NS = _NS // 10
_COMMANDS_REMEMBERED = 255
"""Fewer where their counter goes round sooner: each counter names one command."""


def command(
    setup: Setup, state: CycleState, decision: Decision | None, reading: Reading | None, now_ns: int
) -> tuple[CycleState, list[CanFrame]]:
    """Return the state and the command frame, if one may leave."""
    here_m = reading.position_m if reading else state.setpoint_m
    last_ma, elapsed_s = _last(setup, state, here_m, now_ns)
    wanted_ma = decision.current_ma if decision else state.guard.manual_ma
    current_ma = admit(setup.guard, state.guard, wanted_ma, last_ma, elapsed_s)
    if current_ma is None:
        return replace(state, sent=(), left_ma=state.last_ma if state.sent else state.left_ma), []
    current_ma = inside(setup.codec.field(CurrentCommand, "current_ma"), current_ma, *_limits_ma(setup, state))
    message = CurrentCommand(
        current_ma,
        state.link.position_counter,
        state.link.setpoint_counter,
        state.guard.mode,
        decision.motion if decision else Motion.NONE,
    )
    frame = setup.codec.encode(message, state.command_counter)
    modulus = setup.codec.by_kind[CurrentCommand].counter_modulus
    counter = state.command_counter % modulus
    sent = (*state.sent, SentCommand(counter, current_ma))[-min(_COMMANDS_REMEMBERED, modulus - 1) :]
    return replace(state, sent=sent, command_counter=state.command_counter + 1, command_ns=now_ns), [frame]


def _limits_ma(setup: Setup, state: CycleState) -> tuple[float, float]:
    """Return what a current must not leave when it is rounded to the steps of its signal, in mA."""
    if state.guard.mode is Mode.FAILSAFE:
        return same_signal(setup.guard.failsafe_ma(setup.guard.current_low_ma))
    return setup.guard.current_low_ma, setup.guard.current_high_ma


def _last(setup: Setup, state: CycleState, here_m: float, now_ns: int) -> tuple[float, float]:
    """Return the current in mA that the next one follows, and for how long it has been there in s.

    A limited rate goes on where the last command before a disarming left the actuator; otherwise control begins at the
    current that balances the spring.
    """
    elapsed_s = (now_ns - state.command_ns) / _NS
    if state.last_ma is not None:
        return state.last_ma, elapsed_s
    if state.left_ma is not None and setup.guard.max_rate_ma_per_s > 0.0:
        return state.left_ma, elapsed_s
    return setup.valve.balance_current_ma(here_m), setup.period_s


def status(setup: Setup, state: CycleState, now_ns: int) -> tuple[CycleState, list[CanFrame]]:
    """Return the state and the status frame when one is due; nothing leaves before the positioner was first armed."""
    due = state.status_ns is None or now_ns - state.status_ns >= STATUS_PERIOD_NS
    if not due or not state.guard.ever_armed:
        return state, []
    message = PositionerStatus(
        state.guard.mode,
        state.guard.cause,
        state.guard.health(table_saved=state.table_saved),
        state.guard.armed,
        state.table_saved,
        state.counters.fallbacks % 256,
        state.counters.refused_frames % 256,
        state.counters.learned % 256,
    )
    counters, count = state.counters.next_message()
    frames = [setup.codec.encode(each, state.status_counter) for each in (message, count) if each is not None]
    return replace(state, status_counter=state.status_counter + 1, status_ns=now_ns, counters=counters), frames
