"""The comparison of recorded and computed frames: how many are equal, and the first that differs. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import zip_longest
from typing import TYPE_CHECKING

from positioner.wire.messages import CurrentCommand

if TYPE_CHECKING:
    from positioner.replay.log import LogFrame
    from positioner.replay.run import ReplayedCycle
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame


@dataclass(frozen=True, slots=True)
class Difference:
    """A computed frame that differs from the recorded one; one of the two is None if only the other exists.

    cause: the last frame that the positioner received before it in the same cycle, if there was one.
    """

    time_ns: int
    name: str
    cause: LogFrame | None
    recorded: LogFrame | None
    computed: CanFrame | None


@dataclass(slots=True)
class FrameCounters:
    """Counters of one kind of frame."""

    recorded: int = 0
    computed: int = 0
    equal: int = 0
    differing: int = 0


@dataclass(slots=True)
class Comparison:
    """The comparison so far: counters for each kind of frame by its name, and the first difference."""

    codec: Codec
    exact: bool
    """Whether the log has the exact instants: only then frames that are sent at fixed times are compared."""
    counters: dict[str, FrameCounters] = field(default_factory=dict)
    first: Difference | None = None

    def add(self, replayed: ReplayedCycle) -> None:
        """Compare the frames of one cycle, those of each kind in order."""
        compared = self._by_kind(replayed)
        for name, (recorded, computed) in compared.items():
            counts = self.counters.setdefault(name, FrameCounters())
            counts.recorded += len(recorded)
            counts.computed += len(computed)
            for logged, frame in zip_longest(recorded, computed):
                if logged is not None and frame is not None and logged.frame.data == frame.data:
                    counts.equal += 1
                    continue
                counts.differing += 1
                if self.first is None:
                    self.first = _difference(replayed, name, logged, frame)

    @property
    def identical(self) -> bool:
        """Whether every compared frame is as recorded."""
        return self.first is None

    def _by_kind(self, replayed: ReplayedCycle) -> dict[str, tuple[list[LogFrame], list[CanFrame]]]:
        found: dict[str, tuple[list[LogFrame], list[CanFrame]]] = {}
        for logged in replayed.recorded.outbox:
            found.setdefault(self._name(logged.frame), ([], []))[0].append(logged)
        for frame in replayed.computed:
            if self.exact or self._name(frame) == self.codec.by_kind[CurrentCommand].dbc.name:
                found.setdefault(self._name(frame), ([], []))[1].append(frame)
        return found

    def _name(self, frame: CanFrame) -> str:
        return self.codec.by_id[frame.arbitration_id, frame.is_extended].dbc.name


def _difference(replayed: ReplayedCycle, name: str, logged: LogFrame | None, frame: CanFrame | None) -> Difference:
    cause = replayed.recorded.inbox[-1] if replayed.recorded.inbox else None
    return Difference(replayed.recorded.time_ns, name, cause, logged, frame)
