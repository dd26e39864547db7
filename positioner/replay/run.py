"""The cycles of a log through the very same cycle. Shell, for the law's solver and nothing else."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from positioner.cycle.command_effect import SentCommand
from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState
from positioner.cycle.step import step
from positioner.runtime.record import KIND_AGE, NOTE_ID, NOTED_FIELDS, Note
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import CurrentCommand

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from positioner.config.schema import Configuration
    from positioner.cycle.events import Event
    from positioner.replay.recorded import RecordedCycle
    from positioner.valve.stiction import StictionTable
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame, Mode

_BEGIN_NS = 10**15
"""The instant of a log's first frame: later than any that a frame may have waited for."""
_NS_PER_US = 1000


@dataclass(frozen=True, slots=True)
class ReplayedCycle:
    """One cycle done again: what it was, the frames and events that came of it, and the mode it ended in."""

    recorded: RecordedCycle
    computed: tuple[CanFrame, ...]
    events: tuple[Event, ...]
    mode: Mode


def replay_cycles(
    configuration: Configuration, cycles: Iterable[RecordedCycle], table: StictionTable, *, follows: bool = False
) -> Iterator[ReplayedCycle]:
    """Yield every cycle, done again from `table` on.

    With `follows` the recorded command counts as sent after each cycle, whatever was computed: another law then sees
    the valve move under the current that really moved it.
    """
    setup = configuration.make_setup()
    state = CycleState(table=table)
    for cycle in cycles:
        state, outbox, events = step(setup, state, _told(cycle, table_saved=state.table_saved))
        if follows:
            state = _followed(setup.codec, state, cycle, outbox)
        yield ReplayedCycle(cycle, outbox, events, state.guard.mode)


def _inbox(cycle: RecordedCycle, now_ns: int) -> tuple[CanFrame, ...]:
    """Return the frames that the positioner took in, with their arrival where a note says how long they had waited."""
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


def _told(cycle: RecordedCycle, *, table_saved: bool) -> CycleInput:
    """Return what the cycle was told, the notes' part included; what was said of the table holds until another note."""
    now_ns = _BEGIN_NS + cycle.time_ns
    told = CycleInput(_inbox(cycle, now_ns), now_ns, table_saved=table_saved)
    for logged in cycle.notes:
        note = Note.of(logged.frame.data)
        if note.kind < len(NOTED_FIELDS):
            usual = getattr(told, NOTED_FIELDS[note.kind])
            told = replace(told, **{NOTED_FIELDS[note.kind]: type(usual)(note.value)})
    return told


def _followed(codec: Codec, state: CycleState, cycle: RecordedCycle, outbox: tuple[CanFrame, ...]) -> CycleState:
    """Return the state as if the recorded command had been sent; one that is equal was, to its last decimal."""
    recorded = _commanded(codec, [logged.frame for logged in cycle.outbox])
    if recorded is None or not state.output.sent or recorded == _commanded(codec, outbox):
        return state
    current_ma, counter = recorded
    sent = SentCommand(state.output.sent[-1].counter if counter is None else counter, current_ma)
    return replace(state, output=replace(state.output, sent=(*state.output.sent[:-1], sent)))


def _commanded(codec: Codec, frames: Sequence[CanFrame]) -> tuple[float, int | None] | None:
    """Return current and counter of the command among `frames`, if there is a valid one."""
    for frame in frames:
        try:
            message, counter = codec.decode(frame)
        except FrameRejectedError:
            continue
        if isinstance(message, CurrentCommand):
            return message.current_ma, counter
    return None
