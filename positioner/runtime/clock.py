"""Kinds of time: real, and lockstep with an emulated plant. Shell.

In lockstep the plant's frames are the clock: each step of the position frame's counter is one sample period, and
nothing else makes time pass. Two runs are then the same to the bit, however fast or noisy the machine.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Protocol

from positioner.machine.time import MachineTime, TimePort
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import Setpoint, StemPosition

if TYPE_CHECKING:
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

_NS = 1_000_000_000
_NS_PER_US = 1000


class Clock(Protocol):
    """Tells the instant of a batch of frames; `is_real` where frames arrive, and turns take time, by the same clock."""

    is_real: bool

    def now_ns(self, frames: tuple[CanFrame, ...]) -> int:
        """Return the monotonic instant at which `frames` are handled."""


class RealClock:
    """The machine's monotonic clock in whole microseconds, as logs hold them; a stepped wall clock does not move it."""

    is_real = True

    def __init__(self, time: TimePort | None = None) -> None:
        """Read the machine's clock, or another one."""
        self._time = time or MachineTime()

    def now_ns(self, frames: tuple[CanFrame, ...]) -> int:
        """Return the present instant."""
        del frames
        return self._time.monotonic_ns() // _NS_PER_US * _NS_PER_US


class LockstepClock:
    """Virtual time, driven by the counters of the position frames; the plant waits, so that no turn is late."""

    is_real = False

    def __init__(self, codec: Codec, period_s: float) -> None:
        """Start at zero; the first position frame makes the first period pass."""
        self._codec = codec
        self._form = codec.by_kind[StemPosition]
        self._period_ns = round(period_s * _NS)
        self._counter: int | None = None
        self._now_ns = 0

    def now_ns(self, frames: tuple[CanFrame, ...]) -> int:
        """Return the virtual instant after `frames`."""
        for frame in frames:
            if (frame.arbitration_id, frame.is_extended) == (
                self._form.arbitration_id,
                self._form.dbc.is_extended_frame,
            ):
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
    """Gives every sample the setpoint frames that belong to it, whatever order the bus delivers them in.

    Position and setpoint come from two senders: nothing keeps a bus of datagrams from swapping them on the way to one
    of its listeners, and the host may send ahead. Setpoint n belongs to sample n * `setpoint_every`, and goes before
    its position frame; with 0 frames pass as they come.
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
        """Return what may be handled now; the rest is returned by a later call."""
        if not self._every:
            return frames
        for frame in frames:
            address = (frame.arbitration_id, frame.is_extended)
            self._samples += address == self._position
            (self._setpoints if address == self._setpoint else self._waiting).append(frame)
        due = -(-self._samples // self._every)
        if self._given + len(self._setpoints) < due:
            return ()
        given = [self._setpoints.popleft() for _ in range(due - self._given)]
        ready, self._waiting, self._given = (*given, *self._waiting), [], due
        return ready
