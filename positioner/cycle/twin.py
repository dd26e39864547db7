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

    from positioner.cycle.acting import Sent
    from positioner.cycle.link import Received
    from positioner.guard.state import Sighting
    from positioner.wire.codec import Codec

_DOUBLED_SHARE = 0.75
"""A bus that doubles frames doubles fewer of them than this."""
_EXCESS = 12.0
"""So many more than that share: 48 of 48; where a bus doubles every second frame, in one cycle of 10^12."""


@dataclass(frozen=True, slots=True)
class Returned:
    """Command frames like ours that came back of late. excess: beyond what a bus doubles; sent: ours before."""

    excess: float = 0.0
    sent: int = 0


NOTHING_CAME_BACK = Returned()


def others(
    codec: Codec, received: Received, sent: Sequence[Sent], sent_count: int, before: Returned
) -> tuple[Sighting, list[Event], Returned]:
    """Return what was seen, what happened, and what came back, of `sent_count` commands whose last ones are `sent`.

    A ForeignCommand that is like one of ours is no event, unless as many come back as only a twin sends.
    """
    excess = max(before.excess - _DOUBLED_SHARE * (sent_count - before.sent), 0.0) if sent else 0.0
    seen, events = received.seen, [*received.events]
    if seen.foreign_command:
        step_ma = codec.field(CurrentCommand, "current_ma").si_per_bit
        ours = [event for event in events if isinstance(event, ForeignCommand) and _is_own(event, sent, step_ma)]
        excess += len(ours)
        if excess < _EXCESS:
            events = [event for event in events if event not in ours]
        foreign = any(isinstance(event, ForeignCommand) for event in events)
        seen = replace(seen, foreign_command=foreign, doubled=bool(ours))
    return seen, events, Returned(excess, sent_count)


def _is_own(event: ForeignCommand, sent: Sequence[Sent], step_ma: float) -> bool:
    """Return whether it is like one that we sent: its signal holds the current to a step of `step_ma`."""
    return any(
        each.counter == event.counter and math.isclose(each.current_ma, event.current_ma, abs_tol=step_ma)
        for each in sent
    )
