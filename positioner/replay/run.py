"""The turns of a log through the very same cycle. Shell, for the law's solver and nothing else."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from positioner import cycle
from positioner.cycle import Sent
from positioner.record import TOLD, Note
from positioner.replay.recorded import Heard, Turn
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import CurrentCommand

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from positioner.config import Configuration
    from positioner.cycle import CycleState
    from positioner.events import Event
    from positioner.replay.log import LogFrame
    from positioner.stiction import StictionTable
    from positioner.wire.messages import CanFrame, Mode


@dataclass(frozen=True, slots=True)
class Outcome:
    """One turn done again: what it was, the frames and events that came of it, and the mode it ended in."""

    turn: Turn
    computed: tuple[CanFrame, ...]
    events: tuple[Event, ...]
    mode: Mode


def replayed(
    configuration: Configuration, turns: Sequence[Turn], table: StictionTable, *, follows: bool = False
) -> Iterator[Outcome]:
    """Yield every turn, done again from `table` on.

    With `follows` the recorded command counts as sent after each turn, whatever was computed: another law then sees
    the valve move under the current that really moved it.
    """
    codec = configuration.make_codec()
    period_s = configuration.control.sample_period_s
    setup = cycle.Setup(codec, configuration.valve, configuration.guard, configuration.make_law(), period_s)
    heard = Heard(codec)
    state = cycle.CycleState(table=table)
    for turn in turns:
        inbox = [frame.frame for frame in turn.inbox]
        state, outbox, events = cycle.step(setup, _told(state, turn), inbox, turn.time_ns)
        if follows:
            state = _followed(heard, state, turn.recorded)
        yield Outcome(turn, outbox, events, state.guard.mode)


def _told(state: CycleState, turn: Turn) -> CycleState:
    """Return the state with what the positioner's shell told it; a note says so."""
    for logged in turn.notes:
        note = Note.of(logged.frame.data)
        if note.kind < len(TOLD):
            before = getattr(state, TOLD[note.kind])
            state = replace(state, **{TOLD[note.kind]: type(before)(note.value)})
    return state


def _followed(heard: Heard, state: CycleState, recorded: tuple[LogFrame, ...]) -> CycleState:
    for logged in recorded:
        if not heard.is_command(logged):
            continue
        try:
            message, counter = heard.codec.decode(logged.frame)
        except FrameRejectedError:
            continue
        if isinstance(message, CurrentCommand) and state.sent:
            sent = Sent(state.sent[-1].counter if counter is None else counter, message.current_ma)
            state = replace(state, sent=(*state.sent[:-1], sent))
    return state
