"""The commands to a plant under test: good ones, bad ones, and silence, in turn. Pure.

The phases follow one another by time. Good commands come before each bad phase, so that the plant is seen to stop
obeying, and after it, so that the plant is seen to obey again.
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
"""Of the deadman: after a longer gap between the test's own commands the plant may rightly be in its fail position."""


class Phase(StrEnum):
    """The kind of commands in a phase; the value of a bad phase is the name of the rule that it checks."""

    LISTEN = "listen"
    """Nothing."""
    COMMAND = "command"
    """Good commands."""
    REPEAT = "repeat"
    """One command again and again."""
    DAMAGE = "damage"
    """Commands with a wrong CRC."""
    OLD = "old"
    """Commands with counters that go back."""
    SHORT = "short"
    """Commands of seven bytes."""
    SILENCE = "silence"
    """Nothing, after good commands."""
    RESTART = "restart"
    """Good commands from another counter on, as from a controller that has restarted."""
    FAIL = "fail"
    """A failure signal (NAMUR NE 43)."""


REFUSED = (Phase.REPEAT, Phase.DAMAGE, Phase.OLD, Phase.SHORT)
"""Phases whose commands a plant must refuse."""


@dataclass(frozen=True, slots=True)
class GoodCommand:
    """A good command: the instant at which it was sent, and its counter."""

    instant_ns: int
    counter: int


class Script:
    """The phases in turn; mutable. Good commands lie within `currents_ma`; with None the script only listens."""

    def __init__(
        self, codec: Codec, currents_ma: tuple[float, float] | None, deadman_s: float, settle_s: float, listen_s: float
    ) -> None:
        """Plan the phases; the first call of `goes_on` begins them."""
        self._codec = codec
        self._currents_ma = currents_ma or (0.0, 0.0)
        self.steady_gap_s = _MOST_STEADY_GAP * deadman_s
        long_s, command_s = 2.0 * (deadman_s + settle_s), 3.0 * settle_s + 0.2
        self._phases = [(Phase.LISTEN, max(listen_s, long_s))]
        if currents_ma is not None:
            bad = [(phase, long_s) for phase in (*REFUSED, Phase.SILENCE)]
            for each in (*bad, (Phase.RESTART, command_s), (Phase.FAIL, 3.0 * settle_s)):
                self._phases += [(Phase.COMMAND, command_s), each]
            self._phases.append((Phase.COMMAND, command_s))
        self._index = 0
        self._since_ns: int | None = None
        self.steady_ns = 0
        """The instant since which the phase goes on without a long gap between the test's own commands."""
        self.sent: deque[GoodCommand] = deque(maxlen=_COMMANDS_REMEMBERED)
        self._counter = 0
        self._bad_counter = 0

    @property
    def phase(self) -> Phase:
        """The present phase."""
        return self._phases[self._index][0]

    @property
    def is_first_command(self) -> bool:
        """Whether there was no phase with commands before this one."""
        return self._index <= 1

    @property
    def duration_s(self) -> float:
        """The duration of all phases."""
        return sum(seconds for _, seconds in self._phases)

    def goes_on(self, now_ns: int) -> bool:
        """Begin at the first call, go on to the next phase when it is due; return False after the last one."""
        if self._since_ns is None:
            self._since_ns = self.steady_ns = now_ns
        elif now_ns - self._since_ns >= self._phases[self._index][1] * _NS:
            if self._index + 1 == len(self._phases):
                return False
            self._index += 1
            self._since_ns = self.steady_ns = now_ns
            self._bad_counter = self._counter
            if self.phase is Phase.RESTART:
                self._counter += _AHEAD
        return True

    def answer(self, position_counter: int, now_ns: int) -> CanFrame | None:
        """Return the frame to send after the position frame with `position_counter`."""
        if self.phase in {Phase.LISTEN, Phase.SILENCE}:
            return None
        if self.phase in REFUSED:
            return self._bad(position_counter)
        if self.sent and now_ns - self.sent[-1].instant_ns > self.steady_gap_s * _NS:
            self.steady_ns = now_ns
        self._counter += 1
        self.sent.append(GoodCommand(now_ns, self._counter % 256))
        return self._command(position_counter, self._counter)

    def _bad(self, position_counter: int) -> CanFrame:
        if self.phase is Phase.REPEAT:
            return self._command(position_counter, self._counter)
        if self.phase is Phase.OLD:
            self._bad_counter -= 2 if self._bad_counter < self._counter else _BACK
            if self._counter - self._bad_counter > 2 * _BACK:
                self._bad_counter = self._counter - _BACK
            return self._command(position_counter, self._bad_counter)
        self._bad_counter += 1
        frame = self._command(position_counter, self._bad_counter)
        if self.phase is Phase.SHORT:
            return replace(frame, data=frame.data[:-1])
        return replace(frame, data=bytes([frame.data[0] ^ 0x55, *frame.data[1:]]))

    def _command(self, position_counter: int, counter: int) -> CanFrame:
        low_ma, high_ma = self._currents_ma
        wave = abs(counter % 200 - 100) / 100.0
        current_ma = FAILURE_LOW_MA if self.phase is Phase.FAIL else low_ma + wave * (high_ma - low_ma)
        mode = Mode.FAILSAFE if self.phase is Phase.FAIL else Mode.ACTIVE
        return self._codec.encode(CurrentCommand(current_ma, position_counter, 0, mode, Motion.NONE), counter)
