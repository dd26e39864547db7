"""The CAN port: frames in batches, oldest first, on any bus that python-can knows. Shell.

A bus that is not there yet, goes down or comes back is a state of this port, never an exception in the loop.
"""

from __future__ import annotations

import contextlib
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import can

from positioner.bus.arrivals import Arrivals
from positioner.bus.events import BusBack, BusDown, BusNotOpened, NoFrame, Overrun, SendFailed
from positioner.bus.frame_socket import socket_of
from positioner.bus.message_link import MessageLink
from positioner.bus.opening import OPENING_ERRORS, advice, descriptor_of, dropped_frames, open_bus, opening_error
from positioner.bus.raw_frame import ROOM_WITHIN_S, NoFrameError
from positioner.errors import BusError, BusUnusableError
from positioner.machine.time import MachineTime, TimePort
from positioner.wire.messages import CanFrame

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from positioner.bus.address import BusAddress
    from positioner.bus.events import BusEvent
    from positioner.bus.raw_frame import Link, RawFrame
    from positioner.machine.time import Instant

    OpenBus = Callable[[BusAddress, Iterable[tuple[int, bool]]], can.BusABC]

_MOST_FRAMES_PER_BATCH = 1024
_REOPEN_EVERY_S = 0.5
_NS = 1_000_000_000
_NO_FRAME: RawFrame = (0, b"", False, True, False, 0.0)
"""Stands for what is no frame: it counts as an error frame."""


@dataclass(frozen=True, slots=True)
class Ports:
    """What a loop uses of the machine: its clocks, and the function that opens a bus; None stands for `open_bus`.

    Tests put virtual ones in their place.
    """

    time: TimePort = field(default_factory=MachineTime)
    open_bus: OpenBus | None = None


class BusPort:
    """One node's connection to a bus; opened on first use, and again whenever it was lost.

    room_within_s: how long a frame may wait for room in a full transmit queue.
    """

    def __init__(
        self,
        address: BusAddress,
        identifiers: Iterable[tuple[int, bool]] = (),
        report: Callable[[BusEvent], None] = lambda _event: None,
        ports: Ports | None = None,
    ) -> None:
        """Prepare the port; it receives the `identifiers` (with their extended flag), all if there are none."""
        self.address = address
        self._ports = ports or Ports()
        self._time = self._ports.time
        self._arrivals = Arrivals()
        self._wanted = frozenset(identifiers)
        self._report = report
        self._bus: can.BusABC | None = None
        self._link: Link | None = None
        self._descriptor: int | None = None
        self._was_open = False
        self._trouble: BusEvent | None = None
        self._next_try_s = 0.0
        self._echoes: deque[tuple[int, bytes]] = deque(maxlen=64)
        self._dropped = self._overruns = 0
        self.room_within_s = ROOM_WITHIN_S

    @property
    def is_open(self) -> bool:
        """Whether the bus is there."""
        return self._bus is not None

    @property
    def descriptor(self) -> int | None:
        """The descriptor that is readable once a frame has come; None while the bus is away, or where there is none."""
        return self._descriptor if self._bus is not None else None

    @property
    def gap_ns(self) -> int:
        """For how long the loop did not receive, in ns: see `Arrivals`."""
        return self._arrivals.gap_ns

    def seen_empty(self, looked: Instant) -> None:
        """Remember that nothing waited at the instant `looked`, as a look at the `descriptor` has shown."""
        self._arrivals.seen_empty(looked)

    def open(self) -> None:
        """Open the bus now.

        Raises:
            BusError: it cannot be opened; the message says why and what to do.
            BusUnusableError: no later try can succeed.
        """
        try:
            self._bus = (self._ports.open_bus or open_bus)(self.address, self._wanted)
            self._link = socket_of(self._bus, self.address) or MessageLink(self._bus)
        except OPENING_ERRORS as error:
            self.close()
            raise opening_error(self.address, error) from error
        self._descriptor = descriptor_of(self._bus)
        self._was_open = True
        self._arrivals.reopened(self._time.instant())
        self._dropped = 0
        if self._trouble:
            self._report(BusBack(self.address))
            self._trouble = None

    def receive(self, timeout_s: float) -> tuple[CanFrame, ...]:
        """Return the frames that have arrived, oldest first, after waiting up to `timeout_s` for the first one.

        Raises:
            BusUnusableError: the bus was never open, and no later try can succeed.
        """
        now = self._time.instant()
        self._arrivals.begin(now, timeout_s)
        frames: list[CanFrame] = []
        if self._bus is None and not self.try_open():
            self._time.sleep(min(timeout_s, max(self._next_try_s - self._time.monotonic_s(), 0.0)))
        else:
            self._drain(frames, now, timeout_s)
        self._arrivals.end(self._time.instant())
        return tuple(frames)

    def _drain(self, frames: list[CanFrame], looked: Instant, timeout_s: float) -> None:
        end_ns = looked.monotonic_ns + round(timeout_s * _NS)
        try:
            for _ in range(_MOST_FRAMES_PER_BATCH):  # of any kind: a flood must not keep the cycle waiting
                # an echo, or a frame that is not wanted, does not end the waiting
                raw = self._receive_one(0.0 if frames else max(end_ns - looked.monotonic_ns, 0) / _NS)
                if raw is None:
                    self._arrivals.seen_empty(looked)
                    break
                looked = self._time.instant()
                identifier, data, is_extended, is_error, is_remote, stamp_s = raw
                if self._is_echo(identifier, data):
                    continue
                if not self._wanted or is_error or (identifier, is_extended) in self._wanted:
                    arrived_ns = self._arrivals.arrived_ns(stamp_s, looked)
                    frames.append(CanFrame(identifier, data, is_extended, is_error, is_remote, arrived_ns))
            self._count_overruns()
        except (can.CanError, OSError) as error:
            self._lose(f"{error}; {advice(self.address)}")

    def send(self, frame: CanFrame, deadline_ns: float | None = None) -> bool:
        """Send `frame`; return False if the bus did not take it, or if the monotonic `deadline_ns` had passed."""
        if self._link is None or (deadline_ns is not None and self._time.monotonic_ns() > deadline_ns):
            return False
        try:
            self._link.send(frame, self.room_within_s)
        except (can.CanError, OSError) as error:
            self._report_once(SendFailed(self.address, f"{error}; {advice(self.address)}"))
            return False
        self._trouble = None
        if self.address.is_embedded:
            self._echoes.append((frame.arbitration_id, frame.data))
        return True

    def close(self) -> None:
        """Close the bus."""
        if self._link is not None:
            self._link.close()
            self._link = None
        if self._bus is not None:
            with contextlib.suppress(can.CanError, OSError):
                self._bus.shutdown()
            self._bus = None

    def _receive_one(self, timeout_s: float) -> RawFrame | None:
        assert self._link is not None  # noqa: S101 - receive() has opened it
        try:
            return self._link.receive(timeout_s)
        except NoFrameError as error:
            self._report_once(NoFrame(self.address, str(error)))
            return _NO_FRAME

    def _count_overruns(self) -> None:
        dropped = dropped_frames(self._bus)
        if dropped > self._dropped:
            self._overruns += dropped - self._dropped
            self._dropped = dropped
            self._report(Overrun(self.address, self._overruns))

    def _is_echo(self, identifier: int, data: bytes) -> bool:
        """Return whether a frame is our own: UDP multicast gives a sender its own frames, in the order it sent them."""
        if (identifier, data) not in self._echoes:
            return False
        while self._echoes.popleft() != (identifier, data):
            pass
        return True

    def try_open(self) -> bool:
        """Open the bus, if the next try is due; return whether it is open.

        Raises:
            BusUnusableError: it was never open, and no later try can succeed.
        """
        if self._time.monotonic_s() < self._next_try_s:
            return False
        self._next_try_s = self._time.monotonic_s() + _REOPEN_EVERY_S
        try:
            self.open()
        except BusError as error:
            if isinstance(error, BusUnusableError) and not self._was_open:
                raise
            self._report_once(BusNotOpened(self.address, str(error)))
        return self._bus is not None

    def _lose(self, reason: str) -> None:
        self.close()
        self._echoes.clear()
        self._next_try_s = self._time.monotonic_s() + _REOPEN_EVERY_S
        self._report_once(BusDown(self.address, reason))

    def _report_once(self, trouble: BusEvent) -> None:
        """Report trouble, unless it is the same as in the last report."""
        if trouble != self._trouble:
            self._trouble = trouble
            self._report(trouble)
