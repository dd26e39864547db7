"""The cycles in a log of the bus that another node wrote, found by the counters that the commands echo. Pure.

Bus, positioner and logger may delay or reorder frames. But a command that echoes position counter k and setpoint
counter s was computed from all frames up to these two, and from no later one. Sometimes only later frames show to which
cycle a frame belongs; so each frame waits until `MOST_FRAMES` later ones are known.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.replay.recorded import MOST_FRAMES, FrameClassifier, RecordedCycle
from positioner.wire.messages import CurrentCommand

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from positioner.replay.log import LogFrame

_CONTACT_PERIODS = 10
"""A reading that no command echoes was received in the same cycle as the next reading, if commands came within so many
periods before and after it."""
_MOST_LOST = 10
_READINGS_SEARCHED = 129
_READINGS_REMEMBERED = 3


@dataclass(slots=True)
class _Entry:
    """A frame, and its role in the log as far as it is known."""

    logged: LogFrame
    is_position: bool
    is_setpoint: bool
    counter: int | None
    """Its counter, if it is a reading or a setpoint."""
    is_own: bool = False
    """Whether it is this positioner's command: its counter follows those of the commands before it."""
    answered: int | None = None
    """The number of the reading that this command echoes; a repeated command echoes none."""
    is_echoed: bool = False
    """Whether a command echoes this reading."""


def bus_cycles(classifier: FrameClassifier, frames: Iterable[LogFrame], period_ns: int) -> Iterator[RecordedCycle]:
    """Yield a cycle for each command, and one for each reading while the positioner was silent."""
    contact_ns = _CONTACT_PERIODS * period_ns
    last_ns: int | None = None
    waiting: list[_Entry] = []
    for entry, ahead in _with_next_frames(_Echoes(classifier), frames):
        frame = entry.logged
        if entry.is_own:
            taken = _inputs_of(classifier, waiting, entry)
            waiting = [each for each in waiting if each.logged.number not in taken]
            yield RecordedCycle(frame.time_ns, tuple(taken.values()), (frame,))
            last_ns = frame.time_ns
        elif classifier.is_output(frame) and not classifier.is_command(frame):
            continue  # when a status is sent depends on the instant, which this log does not have
        else:
            waiting.append(entry)
            alone = entry.is_position and not entry.is_echoed and not _in_contact(frame, last_ns, contact_ns, ahead)
            if alone or (last_ns is None and len(waiting) == MOST_FRAMES):
                yield RecordedCycle(frame.time_ns, tuple(each.logged for each in waiting))
                waiting = []
            elif len(waiting) == MOST_FRAMES:  # neither positioner nor sensor sends any more
                del waiting[: MOST_FRAMES // 2]


def _with_next_frames(echoes: _Echoes, frames: Iterable[LogFrame]) -> Iterator[tuple[_Entry, deque[_Entry]]]:
    """Yield each frame with those that follow it, up to `MOST_FRAMES`."""
    ahead: deque[_Entry] = deque()
    for frame in frames:
        ahead.append(echoes.add(frame))
        if len(ahead) > MOST_FRAMES:
            yield ahead.popleft(), ahead
    while ahead:
        yield ahead.popleft(), ahead


class _Echoes:
    """Finds the positioner's own commands, and the reading that each of them echoes."""

    def __init__(self, classifier: FrameClassifier) -> None:
        self._classifier = classifier
        self._modulus = classifier.codec.by_kind[CurrentCommand].counter_modulus
        self._expected: int | None = None
        self._recent: deque[int | None] = deque(maxlen=_READINGS_REMEMBERED)
        self._readings: deque[_Entry] = deque(maxlen=_READINGS_SEARCHED)

    def add(self, frame: LogFrame) -> _Entry:
        """Return the entry of the next frame; a later frame may still set its `is_echoed`."""
        classifier = self._classifier
        is_position, is_setpoint = classifier.is_position(frame), classifier.is_setpoint(frame)
        entry = _Entry(
            frame, is_position, is_setpoint, classifier.counter(frame) if is_position or is_setpoint else None
        )
        if is_position:
            self._recent.append(entry.counter)
            self._readings.append(entry)
        elif classifier.is_command(frame):
            echo = classifier.echo(frame, "position_counter")
            entry.is_own = self._follows(classifier.counter(frame), echo)
            if entry.is_own:
                entry.answered = self._answered(echo)
        return entry

    def _follows(self, counter: int | None, echo: int | None) -> bool:
        """Return whether the counter of a command follows those before it."""
        step = 0 if counter is None or self._expected is None else (counter - self._expected) % self._modulus
        if step and (step > _MOST_LOST or echo not in self._recent):
            return False
        self._expected = None if counter is None else (counter + 1) % self._modulus
        return True

    def _answered(self, echo: int | None) -> int | None:
        """Return the number of the latest reading with this counter; it and earlier readings are not searched again.

        Without a counter it is the latest reading.
        """
        for reading in reversed(self._readings):
            if echo is None or reading.counter == echo:
                reading.is_echoed = True
                while self._readings.popleft() is not reading:
                    pass
                return reading.logged.number
        return None


def _in_contact(frame: LogFrame, last_ns: int | None, contact_ns: int, ahead: Iterable[_Entry]) -> bool:
    """Return whether commands came shortly before and shortly after a frame."""
    if last_ns is None or abs(frame.time_ns - last_ns) > contact_ns:
        return False
    if last_ns >= frame.time_ns:
        return True
    for each in ahead:
        later_ns = each.logged.time_ns - frame.time_ns
        if later_ns > contact_ns:
            return False
        if each.is_own and later_ns >= 0:
            return True
    return False


def _inputs_of(classifier: FrameClassifier, waiting: list[_Entry], command: _Entry) -> dict[int, LogFrame]:
    """Return those of the `waiting` frames from which the command was computed, by their numbers."""
    setpoint = classifier.echo(command.logged, "setpoint_counter")
    candidates = (each for each in waiting if each.is_setpoint and (setpoint is None or each.counter == setpoint))
    newest = max((each.logged.number for each in candidates), default=0)
    taken: dict[int, LogFrame] = {}
    for each in waiting:
        number = each.logged.number
        if each.is_setpoint:
            takes = number <= newest
        elif each.is_position:
            passed_over = not each.is_echoed and command.answered is None
            takes = passed_over or (command.answered is not None and number <= command.answered)
        else:
            takes = True
        if takes:
            taken[number] = each.logged
    return taken
