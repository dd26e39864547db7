"""Counts by cause of all that was refused, lost or late, told one after another behind the status. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from positioner.cycle.events import (
    FeedbackRefused,
    ForeignCommand,
    FrameRefused,
    FramesLost,
    LinesDropped,
    OrderDisputed,
    SetpointRefused,
)
from positioner.cycle.timing_events import LawLate, Stalled
from positioner.cycle.trust_events import PushFailed
from positioner.wire.formats import Reason
from positioner.wire.messages import Counted, PositionerCount

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from positioner.cycle.events import Event

COUNTED_REASONS: Mapping[Reason, Counted] = {
    Reason.WRONG_LENGTH: Counted.WRONG_LENGTH,
    Reason.WRONG_CRC: Counted.WRONG_CRC,
    Reason.OUT_OF_RANGE: Counted.OUT_OF_RANGE,
    Reason.UNDEFINED_VALUE: Counted.UNDEFINED_VALUE,
    Reason.REPEATED: Counted.REPEATED,
    Reason.OUT_OF_ORDER: Counted.OUT_OF_ORDER,
    Reason.ERROR_FRAME: Counted.ERROR_FRAME,
    Reason.REMOTE_FRAME: Counted.REMOTE_FRAME,
}
"""Frames under an unknown identifier are other nodes' traffic, and not counted."""

_COUNTED_EVENTS: Mapping[type[Event], Counted] = {
    SetpointRefused: Counted.SETPOINT_REFUSED,
    OrderDisputed: Counted.DISPUTED,
    ForeignCommand: Counted.FOREIGN_COMMAND,
    LawLate: Counted.LAW_LATE,
    PushFailed: Counted.PUSH_FAILED,
    Stalled: Counted.STALLED,
}
_MODULUS = 1 << 32


@dataclass(frozen=True, slots=True)
class Counters:
    """How often each cause was counted since the start, and which count was told last."""

    counts: Mapping[Counted, int] = field(default_factory=dict)
    told: Counted | None = None

    def add(self, events: Iterable[Event]) -> Counters:
        """Return the counters with what `events` count; the same one if they count nothing."""
        counts = dict(self.counts)
        for event in events:
            for what, number in _counted(event):
                counts[what] = counts.get(what, 0) + number
        return Counters(counts, self.told) if counts != self.counts else self

    def next_told(self) -> tuple[Counters, PositionerCount | None]:
        """Return the message of the next count, in turn, and the counters that know; None while all is zero."""
        if not self.counts:
            return self, None
        kinds = sorted(self.counts)
        after = [kind for kind in kinds if self.told is not None and kind > self.told]
        kind = after[0] if after else kinds[0]
        return Counters(self.counts, kind), PositionerCount(kind, self.counts[kind] % _MODULUS)


def _counted(event: Event) -> tuple[tuple[Counted, int], ...]:
    """Return what an event counts as, and how often; nothing for what is no trouble."""
    match event:
        case FrameRefused():
            return ((COUNTED_REASONS[event.reason], 1),)
        case FramesLost():
            return ((Counted.LOST, event.count),)
        case FeedbackRefused():
            return ((event.counted, 1),)
        case LinesDropped():
            return ((Counted.LINE_DROPPED, event.count),)
        case SetpointRefused() | OrderDisputed() | ForeignCommand() | LawLate() | Stalled() | PushFailed():
            return ((_COUNTED_EVENTS[type(event)], 1),)
        case _:
            return ()
