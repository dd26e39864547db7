"""What is sent to a plant under examination: good commands, bad ones, and silence, in turn. Pure.

Each act follows the one before after its time. The plant is commanded before each bad act, so that it is seen to cease
obeying, and after it, so that it is seen to obey again.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

from positioner.wire.loop_current import FAILURE_LOW_MA
from positioner.wire.messages import CanFrame, CurrentCommand, Mode, Motion

if TYPE_CHECKING:
    from positioner.wire.codec import Codec

_NS = 1_000_000_000
_COMMANDS_REMEMBERED = 256
_BACK = 50
_AHEAD = 100
_MOST_STEADY_GAP = 0.3
"""Of the deadman: after a longer gap between our own commands the plant may rightly have given up."""


class Act(StrEnum):
    """What we do for a while."""

    LISTEN = "listen"
    COMMAND = "command"
    REPEAT = "repeat one command"
    DAMAGE = "send commands with a wrong CRC"
    OLD = "send commands with counters that go back"
    SHORT = "send commands of seven bytes"
    SILENCE = "send nothing"
    RESTART = "go on with another counter, as a controller that has restarted"
    FAIL = "send a failure signal"


REFUSED = frozenset({Act.REPEAT, Act.DAMAGE, Act.OLD, Act.SHORT})
"""Acts that a plant must not obey."""


@dataclass(frozen=True, slots=True)
class Sent:
    """A command that a plant must take over: when it left, and its counter."""

    instant_ns: int
    counter: int


class Script:
    """The acts in turn; mutable. `currents_ma` are the lowest and highest that may be commanded, None for listening."""

    def __init__(
        self, codec: Codec, currents_ma: tuple[float, float] | None, deadman_s: float, settle_s: float, listen_s: float
    ) -> None:
        """Plan; the first call of `at` begins it."""
        self._codec = codec
        self._currents_ma = currents_ma or (0.0, 0.0)
        self.steady_gap_s = _MOST_STEADY_GAP * deadman_s
        long_s = 2.0 * (deadman_s + settle_s)
        commanded = (Act.COMMAND, 3.0 * settle_s + 0.2)
        bad = [(act, long_s) for act in (Act.REPEAT, Act.DAMAGE, Act.OLD, Act.SHORT, Act.SILENCE)]
        steps = [(Act.LISTEN, max(listen_s, long_s))]
        if currents_ma is not None:
            for each in (*bad, (Act.RESTART, commanded[1]), (Act.FAIL, 3.0 * settle_s)):
                steps += [commanded, each]
            steps.append(commanded)
        self._steps = steps
        self._index = 0
        self.since_ns: int | None = None
        self.steady_ns = 0
        self.sent: deque[Sent] = deque(maxlen=_COMMANDS_REMEMBERED)
        self._counter = 0
        self._bad_counter = 0

    @property
    def act(self) -> Act:
        """What we do now."""
        return self._steps[self._index][0]

    @property
    def is_first_command(self) -> bool:
        """Whether nothing but listening went before."""
        return self._index <= 1

    @property
    def duration_s(self) -> float:
        """How long all of it takes."""
        return sum(seconds for _, seconds in self._steps)

    def at(self, now_ns: int) -> bool:
        """Go on to the act that is due at `now_ns`; return False when all is over."""
        if self.since_ns is None:
            self.since_ns = self.steady_ns = now_ns
        elif now_ns - self.since_ns >= self._steps[self._index][1] * _NS:
            if self._index + 1 == len(self._steps):
                return False
            self._index += 1
            self.since_ns = self.steady_ns = now_ns
            self._bad_counter = self._counter
            if self.act is Act.RESTART:
                self._counter += _AHEAD
        return True

    def answer(self, position_counter: int, now_ns: int) -> CanFrame | None:
        """Return what to send after a position frame."""
        if self.act in {Act.LISTEN, Act.SILENCE}:
            return None
        if self.act in REFUSED:
            return self._bad(position_counter)
        if self.sent and now_ns - self.sent[-1].instant_ns > self.steady_gap_s * _NS:
            self.steady_ns = now_ns
        self._counter += 1
        frame = self._command(position_counter, self._counter)
        self.sent.append(Sent(now_ns, self._counter % 256))
        return frame

    def _bad(self, position_counter: int) -> CanFrame:
        if self.act is Act.REPEAT:
            return self._command(position_counter, self._counter)
        if self.act is Act.OLD:
            self._bad_counter -= 2 if self._bad_counter < self._counter else _BACK
            if self._counter - self._bad_counter > 2 * _BACK:
                self._bad_counter = self._counter - _BACK
            return self._command(position_counter, self._bad_counter)
        self._bad_counter += 1
        frame = self._command(position_counter, self._bad_counter)
        if self.act is Act.SHORT:
            return replace(frame, data=frame.data[:-1])
        return replace(frame, data=bytes([frame.data[0] ^ 0x55, *frame.data[1:]]))

    def _command(self, position_counter: int, counter: int) -> CanFrame:
        low_ma, high_ma = self._currents_ma
        wave = abs(counter % 200 - 100) / 100.0
        current_ma = FAILURE_LOW_MA if self.act is Act.FAIL else low_ma + wave * (high_ma - low_ma)
        mode = Mode.FAILSAFE if self.act is Act.FAIL else Mode.ACTIVE
        return self._codec.encode(CurrentCommand(current_ma, position_counter, 0, mode, Motion.NONE), counter)
