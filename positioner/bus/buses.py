"""Several ports, one wait: the frames of every bus as soon as they come. Shell."""

from __future__ import annotations

import select
from typing import TYPE_CHECKING

from positioner.bus.arrivals import Arrivals

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.bus.port import BusPort
    from positioner.machine.time import Instant, TimePort
    from positioner.wire.messages import CanFrame

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

    def receive(self, timeout_s: float) -> tuple[tuple[CanFrame, ...], ...]:
        """Return the frames that have arrived on each port, after waiting up to `timeout_s` for the first one of all.

        Raises:
            BusUnusableError: a bus was never open, and no later try can succeed.
        """
        if len(self._ports) == 1:
            return (self._ports[0].receive(timeout_s),)
        looked = self._time.instant()
        self._arrivals.begin(looked, timeout_s)
        end_ns = looked.monotonic_ns + round(timeout_s * _NS)
        # a port that is away opens its bus here, where that is due
        batches = tuple(() if port.is_open else port.receive(0.0) for port in self._ports)
        while not any(batches):
            batches = self._look(looked, max(end_ns - looked.monotonic_ns, 0) / _NS)
            looked = self._time.instant()
            if looked.monotonic_ns >= end_ns:
                break
        self._arrivals.end(self._time.instant())
        return batches

    def _look(self, now: Instant, timeout_s: float) -> tuple[tuple[CanFrame, ...], ...]:
        """Return the frames of each port, after a wait that ends early where one is readable, or may be."""
        descriptors = [port.descriptor for port in self._ports if port.descriptor is not None]
        if any(port.is_open and port.descriptor is None for port in self._ports):
            timeout_s = min(timeout_s, _LOOK_EVERY_S)
        readable: Sequence[int] = ()
        if descriptors:
            readable, _, _ = select.select(descriptors, (), (), timeout_s)
        else:
            self._time.sleep(timeout_s)
        return tuple(self._frames(port, now, readable) for port in self._ports)

    def _frames(self, port: BusPort, looked: Instant, readable: Sequence[int]) -> tuple[CanFrame, ...]:
        if port.descriptor in readable or (port.is_open and port.descriptor is None):
            return port.receive(0.0)
        port.seen_empty(looked)
        return ()
