"""The turns in a log that somebody else wrote on the bus: the counters that commands echo tell them apart. Pure.

Whatever order or delay the bus, the positioner and the logger had: a command that echoes position counter k and
setpoint counter s was made of all frames up to these two, and of no later one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.replay.recorded import Heard, Turn, command_echo
from positioner.wire.messages import CurrentCommand

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from positioner.replay.log import LogFrame

_PERIODS_IN_TOUCH = 10
"""A reading that no command echoes was taken together with the next one, if commands came within so many periods."""
_MOST_LOST = 10
_READINGS_SEARCHED = 128


def bus_turns(heard: Heard, frames: Sequence[LogFrame], period_ns: int) -> Iterator[Turn]:
    """Yield the turns that commands close, and one for each reading while the positioner was silent."""
    own = _own_commands(heard, frames)
    answers = _answers(heard, frames, own)
    echoed = set(answers.values())
    touch_ns = _PERIODS_IN_TOUCH * period_ns
    commanded_at = sorted(frames[index].time_ns for index in own)
    last_ns: int | None = None
    later = 0
    waiting: list[int] = []
    loose: list[LogFrame] = []
    for index, frame in enumerate(frames):
        if index in own:
            taken = _taken(heard, frames, waiting, frame, answers.get(index), echoed)
            waiting = [each for each in waiting if each not in taken]
            yield Turn(frame.time_ns, tuple(frames[each] for each in sorted(taken)), (frame, *loose))
            last_ns, loose = frame.time_ns, []
        elif heard.is_output(frame) and not heard.is_command(frame):
            continue  # when a status was due hangs on the instant, which this log does not tell
        else:
            waiting.append(index)
            while later < len(commanded_at) and commanded_at[later] < frame.time_ns:
                later += 1
            soon = later < len(commanded_at) and commanded_at[later] - frame.time_ns <= touch_ns
            in_touch = soon and last_ns is not None and frame.time_ns - last_ns <= touch_ns
            if heard.is_position(frame) and index not in echoed and not in_touch:
                yield Turn(frame.time_ns, tuple(frames[each] for each in waiting))
                waiting = []


def _own_commands(heard: Heard, frames: Sequence[LogFrame]) -> set[int]:
    """Return where the commands stand that follow one count; those of another controller have another."""
    modulus = heard.codec.by_kind[CurrentCommand].counter_modulus
    own: set[int] = set()
    expected: int | None = None
    recent: list[int | None] = []
    for index, frame in enumerate(frames):
        if heard.is_position(frame):
            recent = [*recent[-2:], heard.counter(frame)]
        if not heard.is_command(frame):
            continue
        counter = heard.counter(frame)
        step = 0 if counter is None or expected is None else (counter - expected) % modulus
        if step == 0 or (step <= _MOST_LOST and command_echo(heard, frame) in recent):
            own.add(index)
            expected = None if counter is None else (counter + 1) % modulus
    return own


def _answers(heard: Heard, frames: Sequence[LogFrame], own: set[int]) -> dict[int, int]:
    """Return where the reading stands that each command echoes; a repeated command echoes none."""
    answers: dict[int, int] = {}
    readings: list[int] = []
    for index, frame in enumerate(frames):
        if heard.is_position(frame):
            readings = [*readings[-_READINGS_SEARCHED:], index]
        elif index in own and readings:
            wanted = command_echo(heard, frame)
            counters = ((each, heard.counter(frames[each])) for each in reversed(readings))
            found = next((each for each, counter in counters if wanted is None or counter == wanted), None)
            if found is not None:
                answers[index] = found
                readings = [each for each in readings if each > found]
    return answers


def _taken(
    heard: Heard,
    frames: Sequence[LogFrame],
    waiting: list[int],
    command: LogFrame,
    answered: int | None,
    echoed: set[int],
) -> set[int]:
    """Return which of the frames `waiting` the command was made of."""
    obeyed = heard.echo(command, "setpoint_counter")
    setpoints = [each for each in waiting if heard.is_setpoint(frames[each])]
    newest = max((each for each in setpoints if obeyed is None or heard.counter(frames[each]) == obeyed), default=-1)
    taken = {each for each in setpoints if each <= newest}
    for each in waiting:
        if heard.is_setpoint(frames[each]):
            continue
        if heard.is_position(frames[each]):
            passed_over = each not in echoed and answered is None
            if passed_over or (answered is not None and each <= answered):
                taken.add(each)
        else:
            taken.add(each)
    return taken
