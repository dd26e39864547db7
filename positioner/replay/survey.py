"""The first pass over a log: who wrote it, and its first frames. Pure."""

from __future__ import annotations

from collections import Counter
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from positioner.replay.log import LogFrame
    from positioner.replay.recorded import FrameClassifier

_STAMP_NS = 1000


class LogKind(Enum):
    """Who wrote a log, according to its frames; the value is its name in words."""

    RECORD = "the positioner's own record"
    LOCKSTEP = "the log of a lockstep bench"
    BUS = "a log of the bus"

    @property
    def has_instants(self) -> bool:
        """Whether the log has the exact instants of the cycles."""
        return self is not LogKind.BUS


class Survey:
    """The result so far: the number of readings, the first reading, and the positioner's first other frame."""

    def __init__(self, classifier: FrameClassifier, period_ns: int) -> None:
        """Begin; `period_ns` is the sample period."""
        self.readings = 0
        self.first_reading: LogFrame | None = None
        self.first_other: LogFrame | None = None
        """The first frame of the positioner that is not a command."""
        self._classifier = classifier
        self._sent = False
        self._samples = _Samples(classifier, period_ns)

    def add(self, frame: LogFrame) -> None:
        """Add the next frame."""
        classifier = self._classifier
        if not classifier.concerns(frame):
            return
        is_position = classifier.is_position(frame)
        self._samples.add(frame, is_position=is_position)
        if is_position:
            self.readings += 1
            self.first_reading = self.first_reading or frame
        elif classifier.is_output(frame):
            self._sent |= frame.sent
            if not classifier.is_command(frame):
                self.first_other = self.first_other or frame

    @property
    def kind(self) -> LogKind:
        """Who wrote the log."""
        if self._sent:
            return LogKind.RECORD
        return LogKind.LOCKSTEP if self._samples.in_lockstep() else LogKind.BUS


class _Samples:
    """Checks whether every frame is at a whole number of periods, and each command at the time of its reading."""

    def __init__(self, classifier: FrameClassifier, period_ns: int) -> None:
        self._classifier = classifier
        self._period_ns = period_ns
        self._whole = True
        self._commands = self._answering = 0
        self._time_ns = 0
        self._read: set[int | None] = set()
        self._echoes: Counter[int | None] = Counter()

    def add(self, frame: LogFrame, *, is_position: bool) -> None:
        """Add the next frame."""
        self._whole = self._whole and abs(frame.time_ns - snapped(frame, self._period_ns)) <= _STAMP_NS
        if not self._whole:
            return
        if frame.time_ns != self._time_ns:
            self._close()
            self._time_ns = frame.time_ns
        if is_position:
            self._read.add(self._classifier.counter(frame))
        elif self._classifier.is_command(frame):
            self._commands += 1
            self._echoes[self._classifier.echo(frame, "position_counter")] += 1

    def in_lockstep(self) -> bool:
        """Return whether all frames are at whole periods, and most commands at the time of their reading."""
        self._close()
        return self._whole and self._commands > 0 and 2 * self._answering > self._commands

    def _close(self) -> None:
        self._answering += sum(times for echo, times in self._echoes.items() if echo in self._read)
        self._read.clear()
        self._echoes.clear()


def snapped(frame: LogFrame, period_ns: int) -> int:
    """Return the time of a frame in ns, rounded to a whole number of periods."""
    return round(frame.time_ns / period_ns) * period_ns
