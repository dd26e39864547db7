"""The time of the loop: real, by the machine's clock, or virtual, by the frames of an emulated plant. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from positioner.machine.time import MachineTime, TimePort

if TYPE_CHECKING:
    from positioner.wire.messages import CanFrame

_NS_PER_US = 1000


class Clock(Protocol):
    """Gives the instant of a cycle; `is_real` if frames arrive by this clock and cycles take time on it."""

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
