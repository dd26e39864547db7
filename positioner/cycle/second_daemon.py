"""A twin: another positioner on this bus, with a state directory of its own, armed by the same ARM. Pure.

Two that know and see the same send the same frames at first. So a command frame like one that we sent is nobody else's:
a bus that doubles frames brings it back. But a bus doubles some of them, and a twin sends one for each of ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from positioner.cycle.events import Event, ForeignCommand
from positioner.wire.messages import CurrentCommand

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.cycle.command_effect import SentCommand
    from positioner.cycle.link import Received
    from positioner.guard.state import GuardInput
    from positioner.wire.codec import Codec

_DOUBLED_SHARE = 0.75
"""A bus that doubles frames doubles fewer of them than this."""
_EXCESS = 12.0
"""So many more than that share: 48 of 48; where a bus doubles every second frame, in one cycle of 10^12."""


@dataclass(frozen=True, slots=True)
class ReturnedCommands:
    """Command frames like ours that came back of late. excess: beyond what a bus doubles; sent: ours before."""

    excess: float = 0.0
    sent: int = 0


NO_RETURNED_COMMANDS = ReturnedCommands()


def without_own_commands(
    codec: Codec, received: Received, sent: Sequence[SentCommand], sent_count: int, before: ReturnedCommands
) -> tuple[GuardInput, list[Event], ReturnedCommands]:
    """Return what was seen, what happened, and what came back, of `sent_count` commands whose last ones are `sent`.

    A ForeignCommand that is like one of ours is no event, unless as many come back as only a twin sends.
    """
    excess = max(before.excess - _DOUBLED_SHARE * (sent_count - before.sent), 0.0) if sent else 0.0
    guard_input, events = received.guard_input, [*received.events]
    if guard_input.foreign_command:
        step_ma = codec.field(CurrentCommand, "current_ma").si_per_bit
        ours = [event for event in events if isinstance(event, ForeignCommand) and _is_own(event, sent, step_ma)]
        excess += len(ours)
        if excess < _EXCESS:
            events = [event for event in events if event not in ours]
        foreign = any(isinstance(event, ForeignCommand) for event in events)
        guard_input = replace(guard_input, foreign_command=foreign, own_command_returned=bool(ours))
    return guard_input, events, ReturnedCommands(excess, sent_count)


def _is_own(event: ForeignCommand, sent: Sequence[SentCommand], step_ma: float) -> bool:
    """Return whether it is like one that we sent: its signal holds the current to a step of `step_ma`."""
    return any(
        each.counter == event.counter and math.isclose(each.current_ma, event.current_ma, abs_tol=step_ma)
        for each in sent
    )
