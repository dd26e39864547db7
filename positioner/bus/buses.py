"""Several ports, one wait: the frames of every bus as soon as they come. Shell."""

from __future__ import annotations

import select
from typing import TYPE_CHECKING, TypeAlias

from positioner.bus.arrivals import Arrivals

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.bus.port import BusPort
    from positioner.machine.time import Instant, TimePort
    from positioner.wire.messages import CanFrame

    Batch: TypeAlias = tuple[int, tuple[CanFrame, ...]]
    """The number of a port, and its frames, oldest first."""

_LOOK_EVERY_S = 0.001
"""A bus without a descriptor to wait for is looked at this often."""
_NS = 1_000_000_000


class Buses:
    """The ports of one loop."""

    def __init__(self, ports: Sequence[BusPort], time: TimePort) -> None:
        """Wait for the frames of `ports`."""
        self._ports = tuple(ports)
        self._time = time
        self._arrivals = Arrivals()

    @property
    def gap_ns(self) -> int:
        """For how long the loop did not receive, in ns: see `Arrivals`."""
        return self._ports[0].gap_ns if len(self._ports) == 1 else self._arrivals.gap_ns

    def receive(self, timeout_s: float) -> Sequence[Batch]:
        """Return the frames that have arrived, by port, after waiting up to `timeout_s` for the first one of all.

        Raises:
            BusUnusableError: a bus was never open, and no later try can succeed.
        """
        if len(self._ports) == 1:
            frames = self._ports[0].receive(timeout_s)
            return ((0, frames),) if frames else ()
        now = self._time.instant()
        self._arrivals.begin(now, timeout_s)
        end_ns = now.monotonic_ns + round(timeout_s * _NS)
        batches = self._look(now, timeout_s)
        while not batches:
            now = self._time.instant()
            if now.monotonic_ns >= end_ns:
                break
            batches = self._look(now, (end_ns - now.monotonic_ns) / _NS)
        self._arrivals.end(self._time.instant())
        return batches

    def _look(self, now: Instant, timeout_s: float) -> list[Batch]:
        """Return the frames of each port, after a wait that ends early where one is readable, or may be."""
        waiting: dict[int, int] = {}
        ready: list[int] = []
        for number, port in enumerate(self._ports):
            descriptor = port.descriptor
            if descriptor is not None:
                waiting[descriptor] = number
                continue
            ready.append(number)
            if port.is_open:
                timeout_s = min(timeout_s, _LOOK_EVERY_S)
            elif port.try_open():
                timeout_s = 0.0
        if waiting:
            readable = select.select(waiting, (), (), timeout_s)[0]
        else:
            readable = []
            self._time.sleep(timeout_s)
        for descriptor, number in waiting.items():
            if descriptor in readable:
                ready.append(number)
            else:
                self._ports[number].seen_empty(now)
        return [(number, frames) for number in ready if (frames := self._ports[number].receive(0.0))]
