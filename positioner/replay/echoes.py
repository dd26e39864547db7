"""The cycles in a log that somebody else wrote on the bus: the counters that commands echo tell them apart. Pure.

Whatever order or delay the bus, the positioner and the logger had: a command that echoes position counter k and
setpoint counter s was made of all frames up to these two, and of no later one. What a frame was to the positioner may
show in later frames only; so each waits until `MOST_FRAMES` later ones are known.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.replay.recorded import MOST_FRAMES, FrameClassifier, RecordedCycle, command_echo
from positioner.wire.messages import CurrentCommand

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from positioner.replay.log import LogFrame

_PERIODS_IN_TOUCH = 10
"""A reading that no command echoes was taken together with the next one, if commands came within so many periods."""
_MOST_LOST = 10
_READINGS_SEARCHED = 129
_READINGS_REMEMBERED = 3


@dataclass(slots=True)
class _Seen:
    """A frame, and what is known of it."""

    logged: LogFrame
    is_position: bool
    is_setpoint: bool
    counter: int | None
    """Its counter, if it is a reading or a setpoint."""
    is_own: bool = False
    """Whether it is a command of this positioner's; those of another controller have another count."""
    answered: int | None = None
    """The number of the reading that this command echoes; a repeated command echoes none."""
    is_echoed: bool = False
    """Whether a command echoes this reading."""


def bus_cycles(classifier: FrameClassifier, frames: Iterable[LogFrame], period_ns: int) -> Iterator[RecordedCycle]:
    """Yield the cycles that commands close, and one for each reading while the positioner was silent."""
    touch_ns = _PERIODS_IN_TOUCH * period_ns
    last_ns: int | None = None
    waiting: list[_Seen] = []
    for seen, ahead in _with_those_ahead(_Echoes(classifier), frames):
        frame = seen.logged
        if seen.is_own:
            taken = _taken(classifier, waiting, seen)
            waiting = [each for each in waiting if each.logged.number not in taken]
            yield RecordedCycle(frame.time_ns, tuple(taken.values()), (frame,))
            last_ns = frame.time_ns
        elif classifier.is_output(frame) and not classifier.is_command(frame):
            continue  # when a status was due hangs on the instant, which this log does not tell
        else:
            waiting.append(seen)
            alone = seen.is_position and not seen.is_echoed and not _in_touch(frame, last_ns, touch_ns, ahead)
            if alone or (last_ns is None and len(waiting) == MOST_FRAMES):
                yield RecordedCycle(frame.time_ns, tuple(each.logged for each in waiting))
                waiting = []
            elif len(waiting) == MOST_FRAMES:  # it has spoken, and neither it nor the sensor does any more
                del waiting[: MOST_FRAMES // 2]


def _with_those_ahead(echoes: _Echoes, frames: Iterable[LogFrame]) -> Iterator[tuple[_Seen, deque[_Seen]]]:
    """Yield each frame with those that follow it, up to `MOST_FRAMES`."""
    ahead: deque[_Seen] = deque()
    for frame in frames:
        ahead.append(echoes.see(frame))
        if len(ahead) > MOST_FRAMES:
            yield ahead.popleft(), ahead
    while ahead:
        yield ahead.popleft(), ahead


class _Echoes:
    """Tells which commands are the positioner's own, and which reading each of them echoes."""

    def __init__(self, classifier: FrameClassifier) -> None:
        self._classifier = classifier
        self._modulus = classifier.codec.by_kind[CurrentCommand].counter_modulus
        self._expected: int | None = None
        self._recent: deque[int | None] = deque(maxlen=_READINGS_REMEMBERED)
        self._readings: deque[_Seen] = deque(maxlen=_READINGS_SEARCHED)

    def see(self, frame: LogFrame) -> _Seen:
        """Return the next frame; a later one may still tell that it is echoed."""
        classifier = self._classifier
        is_position, is_setpoint = classifier.is_position(frame), classifier.is_setpoint(frame)
        seen = _Seen(frame, is_position, is_setpoint, classifier.counter(frame) if is_position or is_setpoint else None)
        if is_position:
            self._recent.append(seen.counter)
            self._readings.append(seen)
        elif classifier.is_command(frame):
            echo = command_echo(classifier, frame)
            seen.is_own = self._follows(classifier.counter(frame), echo)
            if seen.is_own:
                seen.answered = self._answered(echo)
        return seen

    def _follows(self, counter: int | None, echo: int | None) -> bool:
        """Return whether a command follows the count of those before it."""
        step = 0 if counter is None or self._expected is None else (counter - self._expected) % self._modulus
        if step and (step > _MOST_LOST or echo not in self._recent):
            return False
        self._expected = None if counter is None else (counter + 1) % self._modulus
        return True

    def _answered(self, echo: int | None) -> int | None:
        """Return the number of the latest reading with this counter; neither it nor an earlier one is looked for again.

        Without a counter it is the latest reading.
        """
        for reading in reversed(self._readings):
            if echo is None or reading.counter == echo:
                reading.is_echoed = True
                while self._readings.popleft() is not reading:
                    pass
                return reading.logged.number
        return None


def _in_touch(frame: LogFrame, last_ns: int | None, touch_ns: int, ahead: Iterable[_Seen]) -> bool:
    """Return whether commands came shortly before a frame, and shortly after it."""
    if last_ns is None or abs(frame.time_ns - last_ns) > touch_ns:
        return False
    if last_ns >= frame.time_ns:
        return True
    for each in ahead:
        later_ns = each.logged.time_ns - frame.time_ns
        if later_ns > touch_ns:
            return False
        if each.is_own and later_ns >= 0:
            return True
    return False


def _taken(classifier: FrameClassifier, waiting: list[_Seen], command: _Seen) -> dict[int, LogFrame]:
    """Return which of the frames `waiting` the command was made of, by their numbers."""
    obeyed = classifier.echo(command.logged, "setpoint_counter")
    candidates = (each for each in waiting if each.is_setpoint and (obeyed is None or each.counter == obeyed))
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
