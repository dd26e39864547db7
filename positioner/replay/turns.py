"""From a log to the turns of the positioner that it shows: what each took in, at which instant, and what it sent.

Three kinds of log tell this in three ways (DESIGN.md, "Replay"). The positioner's own record says it outright. In the
log of a lockstep bench, all frames of a sample carry the sample's time. On any other log, the counters that a command
echoes say which frames were in before it, and its time stamp stands for the instant. Pure.
"""

from __future__ import annotations

from enum import Enum
from itertools import groupby
from typing import TYPE_CHECKING

from positioner.replay.echoes import bus_turns
from positioner.replay.recorded import NOTE_ID, Heard, Turn, command_echo

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from positioner.replay.log import LogFrame
    from positioner.wire.codec import Codec

_STAMP_NS = 1000


class LogKind(Enum):
    """Who wrote a log, as far as its frames tell; the value says it in words."""

    RECORD = "the positioner's own record"
    LOCKSTEP = "the log of a lockstep bench"
    BUS = "a log of the bus"

    @property
    def knows_instants(self) -> bool:
        """Whether the log holds the very instants that the cycle was told."""
        return self is not LogKind.BUS


def turns_of(codec: Codec, frames: Sequence[LogFrame], period_s: float) -> tuple[LogKind, tuple[Turn, ...]]:
    """Return the kind of the log, and its turns; `period_s` is the sample period."""
    heard = Heard(codec)
    frames = [frame for frame in frames if heard.concerns(frame)]
    period_ns = round(period_s * 1e9)
    if any(frame.sent and heard.is_output(frame) for frame in frames):
        return LogKind.RECORD, tuple(_recorded_turns(heard, frames))
    if _is_lockstep(heard, frames, period_ns):
        return LogKind.LOCKSTEP, tuple(_lockstep_turns(heard, frames, period_ns))
    return LogKind.BUS, tuple(bus_turns(heard, frames, period_ns))


def _recorded_turns(heard: Heard, frames: Sequence[LogFrame]) -> Iterator[Turn]:
    """Yield the runs of one instant; what comes in after something was sent begins the next."""
    turn: list[LogFrame] = []
    for frame in frames:
        begins = bool(turn) and (frame.time_ns != turn[0].time_ns or (_is_sent(turn[-1]) and not _is_sent(frame)))
        if begins:
            yield _recorded_turn(heard, turn)
            turn = []
        turn.append(frame)
    if turn:
        yield _recorded_turn(heard, turn)


def _is_sent(frame: LogFrame) -> bool:
    return frame.sent and frame.frame.arbitration_id != NOTE_ID


def _recorded_turn(heard: Heard, frames: Sequence[LogFrame]) -> Turn:
    notes = tuple(frame for frame in frames if frame.frame.arbitration_id == NOTE_ID)
    others = [frame for frame in frames if frame.frame.arbitration_id != NOTE_ID]
    return Turn(
        frames[0].time_ns,
        tuple(frame for frame in others if not frame.sent and heard.is_input(frame)),
        tuple(frame for frame in others if frame.sent),
        notes,
    )


def _is_lockstep(heard: Heard, frames: Sequence[LogFrame], period_ns: int) -> bool:
    """Return whether every frame stands at a whole number of periods, and a command at that of its reading."""
    if any(abs(frame.time_ns - _snapped(frame, period_ns)) > _STAMP_NS for frame in frames):
        return False
    read_at = {(frame.time_ns, heard.counter(frame)) for frame in frames if heard.is_position(frame)}
    commands = [frame for frame in frames if heard.is_command(frame)]
    answering = sum((frame.time_ns, command_echo(heard, frame)) in read_at for frame in commands)
    return bool(commands) and 2 * answering > len(commands)


def _snapped(frame: LogFrame, period_ns: int) -> int:
    return round(frame.time_ns / period_ns) * period_ns


def _lockstep_turns(heard: Heard, frames: Sequence[LogFrame], period_ns: int) -> Iterator[Turn]:
    for time_ns, group in groupby(frames, lambda frame: _snapped(frame, period_ns)):
        together = tuple(group)
        commands = [frame for frame in together if heard.is_command(frame)]
        own = {frame.number for frame in commands[-1:]}
        own |= {frame.number for frame in together if heard.is_output(frame) and not heard.is_command(frame)}
        inbox = tuple(frame for frame in together if frame.number not in own)
        # the daemon's clock in lockstep: the first reading makes the first period pass
        yield Turn(time_ns + period_ns, inbox, tuple(frame for frame in together if frame.number in own))
