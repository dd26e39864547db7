"""The machine's clocks, and waiting: the only source of time for the loop. Shell."""

from __future__ import annotations

import time
from typing import NamedTuple, Protocol

_TOGETHER_NS = 100_000
"""Clocks that are read within this time are read together."""
_MOST_READINGS = 5


class Instant(NamedTuple):
    """One instant on both clocks, in ns: the monotonic one, and the wall clock, which may be stepped."""

    monotonic_ns: int
    wall_ns: int


class TimePort(Protocol):
    """The clocks of a loop, and its way to wait."""

    def instant(self) -> Instant:
        """Return the present instant on both clocks."""

    def monotonic_ns(self) -> int:
        """Return the monotonic clock in ns."""

    def monotonic_s(self) -> float:
        """Return the monotonic clock in s."""

    def sleep(self, duration_s: float) -> None:
        """Let `duration_s` pass."""


class MachineTime:
    """The machine's own clocks."""

    def instant(self) -> Instant:
        """Return the present instant on both clocks, read again where this process was interrupted in between."""
        for _ in range(_MOST_READINGS):
            before_ns, wall_ns = time.monotonic_ns(), time.time_ns()
            if time.monotonic_ns() - before_ns < _TOGETHER_NS:
                break
        return Instant(before_ns, wall_ns)

    def monotonic_ns(self) -> int:
        """Return the monotonic clock in ns."""
        return time.monotonic_ns()

    def monotonic_s(self) -> float:
        """Return the monotonic clock in s."""
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        """Let `duration_s` pass."""
        time.sleep(duration_s)
