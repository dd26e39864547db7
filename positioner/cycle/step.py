"""The straight line: one control cycle, from frames to frames. Pure, but for the solver inside the law.

    frames -> receive -> supervise -> estimate -> detect -> learn -> decide -> admit -> encode -> frames

Time is an argument. The same function runs in the daemon, in tests, in replay and in batch simulation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.cycle.command_effect import EFFECT_UNKNOWN, CommandEffect, track_effect
from positioner.cycle.control import control
from positioner.cycle.deviation import NO_DEVIATION, Deviates, Deviation, description, is_reachable, track_deviation
from positioner.cycle.events import Controlled, Event, LinesDropped, ModeChanged
from positioner.cycle.handover import update_handover
from positioner.cycle.hunting import Hunting, Hunts, track_hunting
from positioner.cycle.inbox import receive
from positioner.cycle.outbox import send
from positioner.cycle.second_daemon import without_own_commands
from positioner.cycle.timing_events import LawLate, Stalled
from positioner.cycle.trust_events import ActingChanged
from positioner.cycle.vain_pushes import NO_PUSHES, NoMotion, VainPushes, are_in_vain, track_vain
from positioner.guard.stall import freshness, stall_of
from positioner.guard.state import Conditions
from positioner.guard.supervisor import is_feedback_stale, supervise
from positioner.values import replace
from positioner.wire.messages import Cause, CurrentCommand, Mode

if TYPE_CHECKING:
    from positioner.cycle.input import CycleInput
    from positioner.cycle.link import Reading, Received
    from positioner.cycle.state import CycleState, Setup
    from positioner.guard.state import GuardState
    from positioner.laws.law import Decision
    from positioner.wire.messages import CanFrame

IDLE_COMMAND_PERIOD_S = 0.01
"""Without feedback the last command is repeated this often, whatever the sample period."""
_IDLE_COMMAND_PERIOD_NS = round(IDLE_COMMAND_PERIOD_S * 1e9)


def step(
    setup: Setup, state: CycleState, cycle_input: CycleInput
) -> tuple[CycleState, tuple[CanFrame, ...], tuple[Event, ...]]:
    """Return the state, the frames to send and the events after `cycle_input`.

    With a fresh, plausible reading the loop is closed. Without one only time passes: the guard ages the last reading,
    and in HOLD or FAILSAFE the last command is repeated, as a sign of life for the actuator. A reading that waited
    during a stall is not acted on. A command that could not be sent does not count as the last one.
    """
    state = replace(state)  # this cycle's own copy, which the functions below change in place
    before, now_ns = state.guard, cycle_input.now_ns
    if cycle_input.unsent:
        state.output = replace(state.output, sent=state.output.sent.without_newest())
    stall_ns = stall_of(setup.guard, setup.period_s, cycle_input.late_ns, armed=before.arming.armed)
    # decode, receive
    received = _receive(setup, state, cycle_input, stall_ns)
    reading, events = received.reading, [*received.events, *_shell_events(setup, cycle_input, stall_ns)]
    # supervise
    _supervise(setup, state, cycle_input, received, stall_ns, events)
    # estimate, detect, learn, decide
    decision: Decision | None = None
    if state.guard.controls and reading is not None:
        decision = control(setup, state, reading, cycle_input, events)
        if decision is not None and decision.failed_pushes and state.control.stem is not None:
            stem_m, pushes = state.control.stem.position_m, decision.failed_pushes
            state.deviation = state.deviation.after_failed(pushes, stem_m)
            mean_m = state.deviation.position_m
            state.vain = state.vain.after_failed(setup.valve, pushes, stem_m if mean_m is None else mean_m)
    # admit, encode
    state.counters = state.counters.add(events)
    outbox: list[CanFrame] = []
    stale = stall_ns > 0 or is_feedback_stale(setup.guard, state.guard, setup.period_s, now_ns)
    if reading is not None or (stale and now_ns - state.output.command_ns >= _IDLE_COMMAND_PERIOD_NS):
        outbox = send(setup, state, decision, reading, now_ns)
        if decision is not None and reading is not None:
            events.append(_controlled(state, decision, reading))
    events += _changes(before, state.guard)
    return state, tuple(outbox), tuple(events)


def _receive(setup: Setup, state: CycleState, cycle_input: CycleInput, stall_ns: int) -> Received:
    """Return the result of the frames without the commands like ours, whose record the state then holds."""
    before = state.guard
    commanded_ma = state.output.last_ma if before.controls or before.mode is Mode.MANUAL else None
    fresh = freshness(setup.guard, setup.period_s, cycle_input.now_ns, stalled=stall_ns > 0)
    received = receive(
        setup.codec, setup.guard, setup.valve, state.link, cycle_input.frames, commanded_ma, setup.period_s, fresh
    )
    received, state.returned = without_own_commands(setup.codec, received, state.output, state.returned)
    return received


def _shell_events(setup: Setup, cycle_input: CycleInput, stall_ns: int) -> list[Event]:
    """Return the events of what the shell reports: a late cycle or a stall, and dropped lines of the log."""
    events: list[Event] = []
    if cycle_input.late_ns:
        events.append(Stalled(stall_ns) if stall_ns else LawLate(cycle_input.late_ns, setup.period_s))
    if cycle_input.lines_dropped:
        events.append(LinesDropped(count=cycle_input.lines_dropped))
    return events


def _supervise(
    setup: Setup,
    state: CycleState,
    cycle_input: CycleInput,
    received: Received,
    stall_ns: int,
    events: list[Event],
) -> None:
    """Take over what was received, and the mode that follows; where control ends, its memory is lost."""
    reading, link, before = received.reading, received.link, state.guard
    effect, deviation = _effect(setup, state, reading), _deviation(setup, state, reading, events)
    hunting = _hunting(setup, state, reading, events)
    vain, no_motion = _vain(setup, state, received, deviation, events)
    conditions = Conditions(
        stall_ns=stall_ns,
        late=cycle_input.late_ns > 0,
        answered=state.answered,
        no_effect=effect.fault if setup.learns else None,
        deviation=deviation.cause,
        hunting=hunting is not None and hunting.swings.told,
        no_motion=no_motion,
        period_wrong=link.feedback.frame_period.is_wrong(setup.period_s),
        valve_differs=state.differs,
        testing=setup.testing,
    )
    guard = supervise(setup.guard, before, received.guard_input, setup.period_s, cycle_input.now_ns, conditions)
    measured_m = reading.position_m if reading else None
    if state.control.memory is not None and (not guard.controls or guard.acts_again(before)):
        state.control, state.differs = replace(state.control, memory=None, stem=None), False
    if guard.arming.armed and not before.arming.armed:
        state.output = replace(state.output, status_ns=None)  # an arming is answered at once
    if cycle_input.table is not None:
        state.table = cycle_input.table
    state.table_saved, state.answered = cycle_input.table_saved, False
    state.alarms = cycle_input.alarms
    state.alarmed = state.alarmed or cycle_input.alarms != 0
    state.link, state.effect, state.guard = link, effect, guard
    state.deviation, state.hunting, state.vain = deviation, hunting, vain
    state.handover = update_handover(
        state.handover, guard.mode, measured_m, link.setpoint.position_m, state.output.last_ma
    )


def _effect(setup: Setup, state: CycleState, reading: Reading | None) -> CommandEffect:
    """Return the effect of our commands; it is unknown while none are sent."""
    effect = state.effect if state.guard.controls or state.guard.mode is Mode.MANUAL else EFFECT_UNKNOWN
    if reading is None:
        return effect
    form = setup.codec.by_kind[CurrentCommand]
    return track_effect(effect, state.output.sent, reading, form, reading.periods * setup.period_s)


def _deviation(setup: Setup, state: CycleState, reading: Reading | None, events: list[Event]) -> Deviation:
    """Return the deviation from the law's last setpoint; add an event where it is first reported."""
    if not state.guard.controls:
        return NO_DEVIATION
    if reading is None or state.control.memory is None:
        return state.deviation
    elapsed_s, setpoint_m = reading.periods * setup.period_s, state.control.setpoint_m
    measured_m, sent_ma = reading.position_m, state.output.last_ma
    known = track_deviation(setup.guard, setup.valve, state.deviation, measured_m, setpoint_m, elapsed_s, sent_ma)
    if known.cause is not state.deviation.cause and known.cause is not Cause.NONE:
        events.append(Deviates(description(setup.guard, setup.valve, known, setpoint_m)))
    return known


def _hunting(setup: Setup, state: CycleState, reading: Reading | None, events: list[Event]) -> Hunting | None:
    """Return the swings of the stem under the law; add an event where they are first reported."""
    if not state.guard.controls or setup.testing or setup.guard.deviation_of_span == 0.0:
        return None
    before = state.hunting
    if reading is None or state.control.memory is None:
        return before
    elapsed_s, setpoint_m = reading.periods * setup.period_s, state.control.setpoint_m
    measured_m, sent_ma = reading.position_m, state.output.last_ma
    known = track_hunting(setup.valve, before, measured_m, setpoint_m, elapsed_s, setup.period_s, sent_ma)
    if known is not None and known.swings.told and not (before is not None and before.swings.told):
        events.append(Hunts(known.swings.count, known.swung_s, known.swings.mean_m, setpoint_m))
    return known


def _vain(
    setup: Setup, state: CycleState, received: Received, deviation: Deviation, events: list[Event]
) -> tuple[VainPushes, bool]:
    """Return the pushes that moved nothing, and whether they are in vain; add an event where that is first so."""
    reading, mean_m = received.reading, deviation.position_m
    if not state.guard.controls or setup.testing or mean_m is None:
        return NO_PUSHES, False
    before = state.guard.conditions.no_motion
    if reading is None or state.control.memory is None:
        return state.vain, before
    repeat_s, arrived_ma = received.link.feedback.readings.noise.repeat_s, deviation.push.current_ma
    if arrived_ma is None or (repeat_s == 0.0 and state.vain is NO_PUSHES):
        return NO_PUSHES, False
    if not is_reachable(setup.guard, setup.valve, state.control.setpoint_m, mean_m):
        return NO_PUSHES, False
    elapsed_s = reading.periods * setup.period_s
    vain = track_vain(setup.valve, state.vain, reading.position_m, mean_m, repeat_s, arrived_ma, elapsed_s)
    told = are_in_vain(vain, repeat_s)
    if told and not before:
        events.append(NoMotion(max(vain.count, vain.failed), reading.position_m))
    return vain, told


def _changes(before: GuardState, after: GuardState) -> list[Event]:
    """Return the events of the guard between two states: a new effect of commands, a new mode or cause."""
    events: list[Event] = []
    if after.controls and after.conditions.no_effect is not before.conditions.no_effect:
        events.append(ActingChanged(after.conditions.no_effect))
    if after.mode is not before.mode or after.cause is not before.cause:
        events.append(ModeChanged(before.mode, after.mode, after.cause))
    return events


def _controlled(state: CycleState, decision: Decision, reading: Reading) -> Controlled:
    stem, last_ma = state.control.stem, state.output.last_ma
    assert stem is not None  # noqa: S101 - a decision follows an estimate
    return Controlled(
        time_s=state.control.time_s,
        setpoint_m=state.control.setpoint_m,
        measured_m=reading.position_m,
        stem=stem,
        decision=decision,
        current_ma=last_ma if last_ma is not None else decision.current_ma,
        mode=state.guard.mode,
        table_sequence=state.table.sequence,
    )
