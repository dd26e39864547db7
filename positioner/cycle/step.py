"""The straight line: one control cycle, from frames to frames. Pure, but for the solver inside the law.

    frames -> receive -> supervise -> estimate -> detect -> learn -> decide -> admit -> encode -> frames

Time is an argument. The same function runs in the daemon, in tests, in replay and in batch simulation.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.cycle.command_effect import EFFECT_UNKNOWN, CommandEffect, track_effect
from positioner.cycle.control import control
from positioner.cycle.deviation import NO_DEVIATION, Deviates, Deviation, description, track_deviation
from positioner.cycle.events import Controlled, Event, LinesDropped, ModeChanged
from positioner.cycle.handover import blend, update_handover
from positioner.cycle.inbox import receive
from positioner.cycle.outbox import command, status
from positioner.cycle.second_daemon import without_own_commands
from positioner.cycle.timing_events import LawLate, Stalled
from positioner.cycle.trust_events import ActingChanged
from positioner.guard import stall
from positioner.guard.supervisor import is_feedback_stale, supervise
from positioner.wire.messages import Cause, CurrentCommand, Mode

if TYPE_CHECKING:
    from positioner.cycle.input import CycleInput
    from positioner.cycle.link import Reading
    from positioner.cycle.state import CycleState, Setup
    from positioner.guard.state import GuardInput, GuardState
    from positioner.laws.law import Decision
    from positioner.wire.messages import CanFrame

IDLE_COMMAND_PERIOD_S = 0.01
"""In HOLD and FAILSAFE the actuator hears the last word this often, whatever the sample period."""
_IDLE_COMMAND_PERIOD_NS = round(IDLE_COMMAND_PERIOD_S * 1e9)


def step(
    setup: Setup, state: CycleState, cycle_input: CycleInput
) -> tuple[CycleState, tuple[CanFrame, ...], tuple[Event, ...]]:
    """Return the state, the frames to send and the events after what the cycle was `told`.

    A cycle closes for every batch that holds a fresh, plausible reading. Without one, only time passes: the guard ages
    what it has, and in HOLD or FAILSAFE the last word is repeated so that the actuator hears that somebody is there.
    A reading that waited while nobody looked at the bus is not acted on; a command that did not leave is not the last
    word.
    """
    if cycle_input.unsent:
        state = replace(state, sent=state.sent[:-1])
    before, now_ns = state.guard, cycle_input.now_ns
    commanded_ma = state.last_ma if before.controls or before.mode is Mode.MANUAL else None
    stall_ns = stall.stall_ns(setup.guard, setup.period_s, cycle_input.late_ns, armed=before.armed)
    fresh = stall.freshness(setup.guard, setup.period_s, now_ns, armed=before.armed, stalled=stall_ns > 0)
    received = receive(
        setup.codec, setup.guard, setup.valve, state.link, cycle_input.frames, commanded_ma, setup.period_s, fresh
    )
    guard_input, events, returned = without_own_commands(
        setup.codec, received, state.sent, state.command_counter, state.returned
    )
    events += _of_the_shell(setup, cycle_input, stall_ns)
    if cycle_input.late_ns or before.late_answers:
        guard_input = replace(guard_input, late=cycle_input.late_ns > 0, stall_ns=stall_ns, answered=state.answered)
    reading = received.reading
    effect, guard_input = _track_effect(setup, state, guard_input, reading)
    deviation = _deviation(setup, state, reading, events)
    if deviation.cause is not Cause.NONE:
        guard_input = replace(guard_input, deviation=deviation.cause)
    watch = supervise(setup.guard, before, guard_input, setup.period_s, now_ns)
    measured_m = reading.position_m if reading else None
    handover = update_handover(state.handover, watch.mode, measured_m, received.link.setpoint_m, state.last_ma)
    state = replace(
        state,
        link=received.link,
        returned=returned,
        guard=watch,
        table=state.table if cycle_input.table is None else cycle_input.table,
        table_saved=cycle_input.table_saved,
        answered=False,
        handover=handover,
        effect=effect,
        deviation=deviation,
    )
    decision: Decision | None = None
    if state.memory is not None and (not watch.controls or watch.acts_again(before)):
        state = replace(state, memory=None, stem=None)
    if watch.controls and reading is not None:
        state, decision = control(setup, state, reading, events)
        if handover is not None and decision is not None and state.last_ma is not None:
            handover, decision = blend(handover, decision, state.last_ma, now_ns)
            state = replace(state, handover=handover)

    state = replace(state, counters=state.counters.add(events))
    outbox: list[CanFrame] = []
    stale = stall_ns > 0 or is_feedback_stale(setup.guard, watch, setup.period_s, now_ns)
    if reading is not None or (stale and now_ns - state.command_ns >= _IDLE_COMMAND_PERIOD_NS):
        state, frames = command(setup, state, decision, reading, now_ns)
        outbox += frames
        if decision is not None and reading is not None:
            events.append(_controlled(state, decision, reading))
        state, frames = status(setup, state, now_ns)
        outbox += frames
    events += _changes(before, state.guard)
    return state, tuple(outbox), tuple(events)


def _of_the_shell(setup: Setup, cycle_input: CycleInput, stall_ns: int) -> list[Event]:
    """Return what the shell has told."""
    events: list[Event] = []
    if cycle_input.late_ns:
        events.append(Stalled(stall_ns) if stall_ns else LawLate(cycle_input.late_ns, setup.period_s))
    if cycle_input.lines_dropped:
        events.append(LinesDropped(count=cycle_input.lines_dropped))
    return events


def _track_effect(
    setup: Setup, state: CycleState, guard_input: GuardInput, reading: Reading | None
) -> tuple[CommandEffect, GuardInput]:
    """Return whether our commands act, and the sighting with why they do not; a dry run commands nobody."""
    effect = state.effect if state.guard.controls or state.guard.mode is Mode.MANUAL else EFFECT_UNKNOWN
    if reading is not None:
        form = setup.codec.by_kind[CurrentCommand]
        effect = track_effect(effect, state.sent, reading, form, reading.periods * setup.period_s)
    if effect.fault is not None and setup.learns:
        guard_input = replace(guard_input, idle=effect.fault)
    return effect, guard_input


def _changes(before: GuardState, after: GuardState) -> list[Event]:
    """Return the events of a guard that went from one state to another."""
    events: list[Event] = []
    if after.controls and after.idle is not before.idle:
        events.append(ActingChanged(after.idle))
    if after.mode is not before.mode or after.cause is not before.cause:
        events.append(ModeChanged(before.mode, after.mode, after.cause))
    return events


def _deviation(setup: Setup, state: CycleState, reading: Reading | None, events: list[Event]) -> Deviation:
    """Return what is known of the error, from the setpoint that the law was given last; say when it begins to count."""
    if not state.guard.controls:
        return NO_DEVIATION
    if reading is None or state.memory is None:
        return state.deviation
    elapsed_s, setpoint_m = reading.periods * setup.period_s, state.setpoint_m
    known = track_deviation(setup.guard, setup.valve, state.deviation, reading.position_m, setpoint_m, elapsed_s)
    if known.cause is not state.deviation.cause and known.cause is not Cause.NONE:
        events.append(Deviates(description(setup.guard, setup.valve, known, setpoint_m)))
    return known


def _controlled(state: CycleState, decision: Decision, reading: Reading) -> Controlled:
    stem = state.stem
    assert stem is not None  # noqa: S101 - a decision is made of an estimate
    current_ma = state.last_ma if state.last_ma is not None else decision.current_ma
    return Controlled(
        state.control_s,
        state.setpoint_m,
        reading.position_m,
        stem,
        decision,
        current_ma,
        state.guard.mode,
        state.table.sequence,
    )
