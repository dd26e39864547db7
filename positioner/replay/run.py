"""The cycles of a log, computed again by the same `step`. Shell, only because of the law's solver."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from positioner.cycle.input import CycleInput
from positioner.cycle.sent import SentCommand
from positioner.cycle.state import CycleState
from positioner.cycle.step import step
from positioner.health.observed import observed_cycle
from positioner.replay.recorded import command_in
from positioner.runtime.record import KIND_AGE, NOTE_ID, NOTED_FIELDS, Note

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from positioner.config.schema import Configuration
    from positioner.cycle.events import Event
    from positioner.cycle.state import Setup
    from positioner.health.observed import ObservedCycle
    from positioner.replay.recorded import RecordedCycle
    from positioner.replay.shadow import ReplayedShadow
    from positioner.valve.stiction import StictionTable
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame, Cause, Mode

_BEGIN_NS = 10**15
"""The instant of a log's first frame: so late that the arrival of a frame that waited before it is not negative."""
_NS_PER_US = 1000


@dataclass(frozen=True, slots=True)
class ReplayedCycle:
    """One cycle computed again: the recorded one, its frames and events, mode and cause, what health sees."""

    recorded: RecordedCycle
    computed: tuple[CanFrame, ...]
    events: tuple[Event, ...]
    mode: Mode
    cause: Cause
    observed: ObservedCycle | None


def replay_cycles(
    configuration: Configuration,
    cycles: Iterable[RecordedCycle],
    table: StictionTable,
    *,
    plays: bool = False,
    follows: bool = False,
    setup: Setup | None = None,
    shadow: ReplayedShadow | None = None,
) -> Iterator[ReplayedCycle]:
    """Yield every cycle computed again; the first one starts with `table`.

    With `follows` the recorded command counts as sent after each cycle, instead of the computed one: another law then
    observes the valve with the current that really moved it. `setup` replaces that of the configuration; without it,
    a plug-in is loaded only where the command `plays`. `shadow` compares each cycle with that of another law.

    Raises:
        ConfigurationError: the law is a plug-in that may not be loaded, or cannot be.
    """
    setup = setup or configuration.make_setup(plays=plays)
    state = CycleState(table=table)
    for cycle in cycles:
        before, cycle_input = state, _cycle_input(cycle, state)
        state, outbox, events = step(setup, before, cycle_input)
        observed = observed_cycle(cycle_input, before, state, outbox, events)
        if follows:
            state = _followed(setup.codec, state, cycle, outbox)
        if shadow is not None:
            shadow.cycle(cycle_input, before, state, events)
        yield ReplayedCycle(cycle, outbox, events, state.guard.mode, state.guard.cause, observed)


def _inbox(cycle: RecordedCycle, now_ns: int) -> tuple[CanFrame, ...]:
    """Return the frames that the positioner received; `received_ns` is set where a note gives their waiting time."""
    noted = [logged for logged in cycle.notes if Note.of(logged.frame.data).kind == KIND_AGE]
    if not noted:
        return tuple(logged.frame for logged in cycle.inbox)
    inbox, age_us = [], 0
    for logged in sorted((*noted, *cycle.inbox), key=lambda each: each.number):
        if logged.frame.arbitration_id == NOTE_ID:
            age_us = Note.of(logged.frame.data).value
        else:
            inbox.append(replace(logged.frame, received_ns=now_ns - age_us * _NS_PER_US))
    return tuple(inbox)


def _cycle_input(cycle: RecordedCycle, state: CycleState) -> CycleInput:
    """Return the input of the cycle with the fields of its notes; table and alarms are as before without one."""
    now_ns = _BEGIN_NS + cycle.time_ns
    cycle_input = CycleInput(_inbox(cycle, now_ns), now_ns, table_saved=state.table_saved, alarms=state.alarms)
    for logged in cycle.notes:
        note = Note.of(logged.frame.data)
        if note.kind < len(NOTED_FIELDS):
            usual = getattr(cycle_input, NOTED_FIELDS[note.kind])
            cycle_input = replace(cycle_input, **{NOTED_FIELDS[note.kind]: type(usual)(note.value)})
    return cycle_input


def _followed(codec: Codec, state: CycleState, cycle: RecordedCycle, outbox: tuple[CanFrame, ...]) -> CycleState:
    """Return the state as if the recorded command had been sent; an equal one needs no change of the state."""
    recorded, computed = command_in(codec, (logged.frame for logged in cycle.outbox)), command_in(codec, outbox)
    last = state.output.sent.last
    if recorded is None or last is None:
        return state
    command, counter = recorded
    if computed and (command.current_ma, counter) == (computed[0].current_ma, computed[1]):
        return state
    sent = SentCommand(last.counter if counter is None else counter, command.current_ma)
    return replace(state, output=replace(state.output, sent=state.output.sent.without_newest().with_newest(sent)))
