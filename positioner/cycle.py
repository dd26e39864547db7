"""The straight line: one control cycle, from frames to frames. Pure, but for the solver inside the law.

    frames -> receive -> supervise -> estimate -> detect -> learn -> decide -> admit -> encode -> frames

Time is an argument. The same function runs in the daemon, in tests, in replay and in batch simulation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from positioner import guard
from positioner.events import Controlled, Event, LawFellBack, LawLate, Learned, ModeChanged, MoveBegan
from positioner.guard import GuardSettings, GuardState
from positioner.inbox import LinkState, Reading, receive
from positioner.laws.law import Decision, Observation
from positioner.stick_slip import lessons
from positioner.stiction import StictionTable
from positioner.tally import Tally
from positioner.wire.messages import CanFrame, CurrentCommand, Motion, PositionerStatus

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.estimate import StemState
    from positioner.laws.law import Law
    from positioner.model import ValveParameters
    from positioner.wire.codec import Codec

_NS = 1_000_000_000
STATUS_PERIOD_NS = _NS // 10
_COMMANDS_REMEMBERED = 16
_IDLE_COMMAND_PERIOD_NS = 10_000_000


@dataclass(frozen=True, slots=True)
class Setup:
    """What never changes while a positioner runs. `learns` is off where commands never reach the valve (dry run)."""

    codec: Codec
    valve: ValveParameters
    guard: GuardSettings
    law: Law[Any]
    period_s: float
    learns: bool = True


@dataclass(frozen=True, slots=True)
class Sent:
    """A command that left: its frame's counter (modulo 256) and its current."""

    counter: int
    current_ma: float


@dataclass(frozen=True, slots=True)
class CycleState:
    """Everything a positioner carries on. `memory` is the law's own; the shell tells `table_saved` and `late_ns`."""

    table: StictionTable = field(default_factory=StictionTable)
    guard: GuardState = field(default_factory=GuardState)
    link: LinkState = field(default_factory=LinkState)
    memory: Any = None
    stem: StemState | None = None
    sent: tuple[Sent, ...] = ()
    command_counter: int = 0
    command_ns: int = 0
    status_counter: int = 0
    status_ns: int | None = None
    control_s: float = 0.0
    setpoint_m: float = 0.0
    table_saved: bool = True
    late_ns: int = 0
    tally: Tally = field(default_factory=Tally)
    fallback_count: int = 0
    learned_count: int = 0

    @property
    def last_ma(self) -> float | None:
        """The current commanded last, None before the first."""
        return self.sent[-1].current_ma if self.sent else None


def step(
    setup: Setup, state: CycleState, inbox: Sequence[CanFrame], now_ns: int
) -> tuple[CycleState, tuple[CanFrame, ...], tuple[Event, ...]]:
    """Return the state, the frames to send and the events after the frames in `inbox`, oldest first, at `now_ns`.

    A cycle closes for every batch that holds a fresh, plausible reading. Without one, only time passes: the guard ages
    what it has, and in HOLD or FAILSAFE the last word is repeated so that the actuator hears that somebody is there.
    """
    before = state.guard
    commanded_ma = state.last_ma if before.controls else None
    received = receive(setup.codec, setup.guard, setup.valve, state.link, tuple(inbox), commanded_ma, setup.period_s)
    seen, events = received.seen, [*received.events]
    if state.late_ns:
        seen = replace(seen, late=True)
        events.append(LawLate(state.late_ns, setup.period_s))
    watch = guard.supervise(setup.guard, before, seen, setup.period_s, now_ns)
    state = replace(state, link=received.link, guard=watch, late_ns=0, tally=state.tally.add(events))

    decision: Decision | None = None
    if not watch.controls:
        state = replace(state, memory=None, stem=None) if state.memory is not None else state
    elif received.reading is not None:
        state, decision = _control(setup, state, received.reading, events)

    outbox: list[CanFrame] = []
    stale = guard.is_feedback_stale(setup.guard, watch, setup.period_s, now_ns)
    if received.reading is not None or (stale and now_ns - state.command_ns >= _IDLE_COMMAND_PERIOD_NS):
        state, frames = _command(setup, state, decision, received.reading, now_ns)
        outbox += frames
        if decision is not None and received.reading is not None:
            events.append(_controlled(state, decision, received.reading))
        state, frames = _status(setup, state, now_ns)
        outbox += frames
    if state.guard.mode is not before.mode or state.guard.cause is not before.cause:
        events.append(ModeChanged(before.mode, state.guard.mode, state.guard.cause))
    return state, tuple(outbox), tuple(events)


def _control(
    setup: Setup, state: CycleState, reading: Reading, events: list[Event]
) -> tuple[CycleState, Decision | None]:
    """Return the state after estimate, learning and decision. A law that raises has decided nothing."""
    try:
        if state.memory is None:
            # control begins: hold what is there until the host asks for something else
            here = min(max(reading.position_m, setup.valve.travel_min_m), setup.valve.travel_max_m)
            state = replace(state, memory=setup.law.begin(reading.position_m), stem=None, setpoint_m=here)
        setpoint_m = state.link.setpoint_m if state.link.setpoint_m is not None else state.setpoint_m
        elapsed_s = reading.periods * setup.period_s
        observation = Observation(
            reading.position_m,
            _applied_ma(setup, state, reading),
            elapsed_s,
            setpoint_m,
            state.control_s,
            state.link.pressure_pa,
        )
        memory, stem = setup.law.estimate(state.memory, observation)
        state = _learn(setup, state, stem, observation.applied_ma, events)
        memory, decision = setup.law.decide(memory, stem, observation, state.table)
        _check(decision)
    except Exception as error:  # noqa: BLE001 - whatever a law does, the valve gets a command that somebody chose
        watch = replace(state.guard, law_failures=state.guard.law_failures + 1)
        events.append(LawFellBack(f"{setup.law.name} failed: {type(error).__name__}: {error}"))
        return replace(state, guard=watch, memory=None, stem=None, fallback_count=state.fallback_count + 1), None
    if decision.reason:
        events.append(MoveBegan(decision.reason))
    if decision.fallback:
        events.append(LawFellBack(decision.fallback))
    state = replace(
        state,
        memory=memory,
        stem=stem,
        setpoint_m=setpoint_m,
        control_s=state.control_s + elapsed_s,
        guard=replace(state.guard, law_failures=0) if state.guard.law_failures else state.guard,
        fallback_count=state.fallback_count + bool(decision.fallback),
    )
    return state, decision


def _learn(setup: Setup, state: CycleState, stem: StemState, applied_ma: float, events: list[Event]) -> CycleState:
    """Return the state with what the edge to `stem`, if there is one, teaches its table."""
    if not setup.learns or state.stem is None:
        return state
    table = state.table
    for sample in lessons(state.stem, stem, applied_ma):
        table = table.record(sample.quantity, sample.position_m, sample.direction, sample.value)
        events.append(Learned(sample, table.sequence))
    learned = table.sequence - state.table.sequence
    return replace(state, table=table, learned_count=state.learned_count + learned) if learned else state


def _check(decision: Decision) -> None:
    """Raise ValueError where a law's answer is no current: it then counts as a failure of the law."""
    if not math.isfinite(decision.current_ma):
        raise ValueError(f"a current of {decision.current_ma} mA")


def _applied_ma(setup: Setup, state: CycleState, reading: Reading) -> float:
    """Return the current that acted before the reading: the command that the plant echoes, else the last one."""
    for sent in reversed(state.sent):
        if reading.command_counter is None or sent.counter == reading.command_counter:
            return sent.current_ma
    return state.last_ma if state.last_ma is not None else setup.valve.balance_current_ma(reading.position_m)


def _command(
    setup: Setup, state: CycleState, decision: Decision | None, reading: Reading | None, now_ns: int
) -> tuple[CycleState, list[CanFrame]]:
    """Return the state and the command frame, if one may leave."""
    here_m = reading.position_m if reading else state.setpoint_m
    last_ma = state.last_ma if state.last_ma is not None else setup.valve.balance_current_ma(here_m)
    elapsed_s = (now_ns - state.command_ns) / _NS if state.sent else setup.period_s
    current_ma = guard.admit(setup.guard, state.guard, decision.current_ma if decision else None, last_ma, elapsed_s)
    if current_ma is None:
        return replace(state, sent=()), []
    message = CurrentCommand(
        current_ma,
        reading.counter if reading else None,
        state.link.setpoint_counter,
        state.guard.mode,
        decision.motion if decision else Motion.NONE,
    )
    frame = setup.codec.encode(message, state.command_counter)
    counter = state.command_counter % setup.codec.by_kind[CurrentCommand].counter_modulus
    sent = (*state.sent, Sent(counter, current_ma))[-_COMMANDS_REMEMBERED:]
    return replace(state, sent=sent, command_counter=state.command_counter + 1, command_ns=now_ns), [frame]


def _status(setup: Setup, state: CycleState, now_ns: int) -> tuple[CycleState, list[CanFrame]]:
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
        state.fallback_count % 256,
        state.link.rejected_count % 256,
        state.learned_count % 256,
    )
    tally, count = state.tally.next_told()
    frames = [setup.codec.encode(each, state.status_counter) for each in (message, count) if each is not None]
    return replace(state, status_counter=state.status_counter + 1, status_ns=now_ns, tally=tally), frames


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
