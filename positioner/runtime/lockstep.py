"""Lockstep with an emulated plant: its position frames are the clock, and the plant waits for each command. Shell.

Each step of the position frame's counter is one sample period, and nothing else makes time pass. Two runs are then the
same to the bit, however fast or noisy the machine.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from positioner.errors import UsageError
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import Setpoint, StemPosition

if TYPE_CHECKING:
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

_NS = 1_000_000_000
_MOST_UNANSWERED = 3


class LockstepClock:
    """Virtual time, driven by the counters of the position frames; the plant waits, so that no cycle is late."""

    is_real = False

    def __init__(self, codec: Codec, period_s: float) -> None:
        """Start at zero; the first position frame makes the first period pass."""
        self._form = codec.by_kind[StemPosition]
        self._position = codec.identifier(StemPosition)
        self._period_ns = round(period_s * _NS)
        self._counter: int | None = None
        self._now_ns = 0

    def now_ns(self, frames: tuple[CanFrame, ...]) -> int:
        """Return the virtual instant after `frames`."""
        for frame in frames:
            if frame.identifier == self._position:
                self._advance(frame)
        return self._now_ns

    def _advance(self, frame: CanFrame) -> None:
        try:
            _, counter = self._form.decode(frame)
        except FrameRejectedError:
            return
        if counter is None or self._counter is None:
            steps = 1
        else:
            steps = (counter - self._counter) % self._form.counter_modulus
        self._counter = counter
        self._now_ns += steps * self._period_ns


class LockstepGate:
    """Puts each setpoint frame before the position frame it belongs to, in whatever order the bus delivers them.

    Position and setpoint come from two senders: a bus of datagrams may swap them on the way to a receiver, and the host
    may send ahead. Setpoint n belongs to sample n * `setpoint_every`; with 0 frames pass as they come.
    """

    def __init__(self, codec: Codec, setpoint_every: int) -> None:
        """Start before the first sample."""
        self._every = setpoint_every
        self._position = codec.identifier(StemPosition)
        self._setpoint = codec.identifier(Setpoint)
        self._setpoints: deque[CanFrame] = deque()
        self._waiting: list[CanFrame] = []
        self._samples = 0
        self._given = 0

    def admit(self, frames: tuple[CanFrame, ...]) -> tuple[CanFrame, ...]:
        """Return the frames that may be handled now; the others are returned by a later call."""
        if not self._every:
            return frames
        for frame in frames:
            self._samples += frame.identifier == self._position
            (self._setpoints if frame.identifier == self._setpoint else self._waiting).append(frame)
        due = -(-self._samples // self._every)
        if self._given + len(self._setpoints) < due:
            return ()
        given = [self._setpoints.popleft() for _ in range(due - self._given)]
        ready, self._waiting, self._given = (*given, *self._waiting), [], due
        return ready


class LockstepCheck:
    """Checks that the plant waits for commands: a plant that does not is real, and its frames must not be the clock."""

    def __init__(self, codec: Codec) -> None:
        """Begin before the first frame."""
        self._position = codec.identifier(StemPosition)
        self._is_counted = codec.by_kind[StemPosition].counter is not None
        self._newest = b""
        self._unanswered = 0

    def add(self, frames: tuple[CanFrame, ...], *, answered: bool) -> None:
        """Count the position frames that came while none was answered; a plant in lockstep waits, or sends it again.

        Raises:
            UsageError: the plant does not wait.
        """
        for frame in frames:
            if frame.identifier == self._position:
                self._unanswered += not self._is_counted or frame.data != self._newest
                self._newest = frame.data
        if self._unanswered > _MOST_UNANSWERED:
            raise UsageError(
                f"{self._unanswered} position frames came without an answer: this plant does not wait, and --clock "
                "lockstep is for one that does; leave it out"
            )
        self._unanswered = 0 if answered else self._unanswered
