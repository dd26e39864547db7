"""All counts since the start, which POSITIONER_STATUS and POSITIONER_COUNT report. Pure."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from positioner.cycle.counted_event import CountedEvent
from positioner.cycle.events import FrameRefused, LawFellBack, Learned
from positioner.values import dataclass, replace
from positioner.wire.messages import Counted, PositionerCount

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from positioner.cycle.events import Event

_MODULUS = 1 << 32
_COUNTED = (CountedEvent, LawFellBack, Learned)


@dataclass(frozen=True, slots=True)
class Counters:
    """Counts since the start.

    by_cause: the count of each cause; one of them is sent after each status, `sent` is the cause sent last. The status
        itself has the three totals: frames refused, fallbacks of the law (its failures among them), samples learned.
    """

    by_cause: Mapping[Counted, int] = field(default_factory=dict)
    sent: Counted | None = None
    refused_frames: int = 0
    fallbacks: int = 0
    learned: int = 0

    def add(self, events: Iterable[Event]) -> Counters:
        """Return the counters with `events` counted; the same ones if none of them counts."""
        events = [event for event in events if isinstance(event, _COUNTED)]
        if not events:
            return self
        by_cause = dict(self.by_cause)
        for event in events:
            if isinstance(event, CountedEvent):
                by_cause[event.counted] = by_cause.get(event.counted, 0) + event.count
        return Counters(
            by_cause=by_cause,
            sent=self.sent,
            refused_frames=self.refused_frames + _number(FrameRefused, events),
            fallbacks=self.fallbacks + _number(LawFellBack, events),
            learned=self.learned + _number(Learned, events),
        )

    def next_message(self) -> tuple[Counters, PositionerCount | None]:
        """Return the counters and the message of the cause whose turn it is to be sent; None while all are zero."""
        if not self.by_cause:
            return self, None
        causes = sorted(self.by_cause)
        cause = next((each for each in causes if self.sent is not None and each > self.sent), causes[0])
        return replace(self, sent=cause), PositionerCount(cause, self.by_cause[cause] % _MODULUS)


def _number(kind: type[Event], events: Iterable[Event]) -> int:
    return sum(isinstance(event, kind) for event in events)
