"""The CAN port: frames in batches, oldest first, on whatever bus python-can knows. Shell.

A bus that is not there yet, goes down or comes back is a state of this port, never an exception in the loop.
"""

from __future__ import annotations

import contextlib
import os
import re
import socket
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import can
from annotated_types import Interval

from positioner.errors import BusError
from positioner.wire.messages import CanFrame

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

EMBEDDED_PORT = 43513
_IPV6_MULTICAST_ALL = 29
_IP_MULTICAST_ALL = 49
_RECEIVE_BUFFER_BYTES = 1 << 20
_MOST_FRAMES_PER_BATCH = 1024
_REOPEN_EVERY_S = 0.5
_SEND_TIMEOUT_S = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class BusAddress:
    """The `[bus]` table of a configuration: an interface of python-can, its channel, and a port where it has one."""

    __pydantic_config__: ClassVar = {"extra": "forbid"}

    interface: str = "socketcan"
    channel: str = "can0"
    port: Annotated[int, Interval(ge=1, le=65535)] = EMBEDDED_PORT

    def __str__(self) -> str:
        """The form that `parse_address` reads."""
        port = f"@{self.port}" if self.is_embedded else ""
        return f"{self.interface}:{self.channel}{port}"

    @property
    def is_embedded(self) -> bool:
        """Whether this is python-can's UDP multicast, the bus for machines without one."""
        return self.interface == "udp_multicast"


def parse_address(text: str) -> BusAddress:
    """Return the address in `INTERFACE:CHANNEL[@PORT]`, for example `socketcan:vcan0`.

    Raises:
        BusError: the text has another form.
    """
    found = re.fullmatch(r"([a-z_]+):([^@]+)(?:@(\d{1,5}))?", text)
    port = int(found[3] or EMBEDDED_PORT) if found else 0
    if not found or not 1 <= port <= 65535:  # noqa: PLR2004 - the ports there are
        raise BusError(f"bus '{text}' is not INTERFACE:CHANNEL[@PORT], for example socketcan:vcan0")
    return BusAddress(interface=found[1], channel=found[2], port=port)


def find_vcan() -> BusAddress | None:
    """Return the first virtual CAN interface of this machine that is up, or None."""
    for device in sorted(Path("/sys/class/net").glob("vcan*")):
        with contextlib.suppress(OSError, ValueError):
            if int((device / "flags").read_text(encoding="ascii"), 16) & 1:
                return BusAddress(interface="socketcan", channel=device.name)
    return None


def embedded_address(token: int) -> BusAddress:
    """Return an embedded bus of its own for `token`: an interface-local group, which never leaves this machine.

    Where the machine has no IPv6 it is an IPv4 group, which a time to live of 0 keeps on the machine.
    """
    port = EMBEDDED_PORT + token % 2000
    if _has_interface_local_groups():
        return BusAddress(interface="udp_multicast", channel=f"ff11::7661:6c76:0:{token & 0xFFFF:x}", port=port)
    return BusAddress(interface="udp_multicast", channel=f"239.255.{token >> 8 & 0xFF}.{token & 0xFF}", port=port)


def _has_interface_local_groups() -> bool:
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as sock:
            sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_HOPS, 0)
            sock.sendto(b"", ("ff11::7661:6c76:0:0", EMBEDDED_PORT))
    except OSError:
        return False
    return True


class BusPort:
    """One node's connection to a bus; opened on first use, and again whenever it was lost."""

    def __init__(
        self,
        address: BusAddress,
        identifiers: Iterable[tuple[int, bool]] = (),
        report: Callable[[str], None] = lambda _line: None,
    ) -> None:
        """Prepare the port; `identifiers` (with their extended flag) are all it will receive, none means everything."""
        self.address = address
        self._filters = [
            {"can_id": identifier, "can_mask": 0x1FFFFFFF if extended else 0x7FF, "extended": extended}
            for identifier, extended in identifiers
        ]
        self._report = report
        self._bus: can.BusABC | None = None
        self._complaint = ""
        self._next_try_s = 0.0
        self._echoes: deque[tuple[int, bytes]] = deque(maxlen=64)
        self.send_failures = 0

    @property
    def is_open(self) -> bool:
        """Whether the bus is there."""
        return self._bus is not None

    def open(self) -> None:
        """Open the bus now.

        Raises:
            BusError: it cannot be opened; the message says why and what to do.
        """
        try:
            self._bus = _open(self.address, self._filters)
        except (can.CanError, OSError, ValueError, ImportError) as error:
            raise BusError(f"bus {self.address} cannot be opened: {error}; {_mend(self.address)}") from error
        if self._complaint:
            self._report(f"bus {self.address} is there again")
            self._complaint = ""

    def receive(self, timeout_s: float) -> tuple[CanFrame, ...]:
        """Return what has arrived, oldest first, after waiting up to `timeout_s` for the first frame."""
        if self._bus is None and not self._try_open():
            time.sleep(min(timeout_s, max(self._next_try_s - time.monotonic(), 0.0)))
            return ()
        frames: list[CanFrame] = []
        wait_s = timeout_s
        try:
            while len(frames) < _MOST_FRAMES_PER_BATCH and (message := self._receive_one(wait_s)) is not None:
                wait_s = 0.0
                frame = _frame(message)
                if not self._is_echo(frame):
                    frames.append(frame)
        except (can.CanError, OSError) as error:
            self._lose(f"bus {self.address} is down: {error}; {_mend(self.address)}")
        return tuple(frames)

    def send(self, frame: CanFrame) -> bool:
        """Send `frame`; False when the bus did not take it."""
        if self._bus is None:
            return False
        message = can.Message(
            arbitration_id=frame.arbitration_id,
            data=frame.data,
            is_extended_id=frame.is_extended,
            check=False,
        )
        try:
            self._bus.send(message, timeout=_SEND_TIMEOUT_S if not self.address.is_embedded else None)
        except (can.CanError, OSError) as error:
            self.send_failures += 1
            self._complain(f"bus {self.address} did not take a frame: {error}; {_mend(self.address)}")
            return False
        if self.address.is_embedded:
            self._echoes.append((frame.arbitration_id, frame.data))
        return True

    def close(self) -> None:
        """Give the bus back."""
        if self._bus is not None:
            with contextlib.suppress(can.CanError, OSError):
                self._bus.shutdown()
            self._bus = None

    def _receive_one(self, timeout_s: float) -> can.Message | None:
        assert self._bus is not None  # noqa: S101 - receive() has opened it
        try:
            return self._bus.recv(timeout_s)
        except can.CanOperationError as error:
            if not self.address.is_embedded:
                raise
            # whatever is no frame on the embedded bus is dropped; the socket itself is sound
            self._complain(f"bus {self.address}: something that is no CAN frame was dropped ({error})")
            return can.Message(is_error_frame=True)

    def _is_echo(self, frame: CanFrame) -> bool:
        """Return whether `frame` is our own: UDP multicast hands a sender its own frames, in the order it sent them."""
        if not self.address.is_embedded or (frame.arbitration_id, frame.data) not in self._echoes:
            return False
        while self._echoes.popleft() != (frame.arbitration_id, frame.data):
            pass
        return True

    def _try_open(self) -> bool:
        if time.monotonic() < self._next_try_s:
            return False
        self._next_try_s = time.monotonic() + _REOPEN_EVERY_S
        try:
            self.open()
        except BusError as error:
            self._complain(str(error))
        return self._bus is not None

    def _lose(self, complaint: str) -> None:
        self.close()
        self._echoes.clear()
        self._next_try_s = time.monotonic() + _REOPEN_EVERY_S
        self._complain(complaint)

    def _complain(self, complaint: str) -> None:
        if complaint != self._complaint:
            self._complaint = complaint
            self._report(complaint)


def _open(address: BusAddress, filters: list[dict[str, int | bool]]) -> can.BusABC:
    if not address.is_embedded:
        return can.Bus(interface=address.interface, channel=address.channel, can_filters=filters or None)
    bus = can.Bus(interface="udp_multicast", channel=address.channel, port=address.port, hop_limit=0, fd=False)
    _confine(bus, address.channel)
    return bus


def _confine(bus: can.BusABC, group: str) -> None:
    """Make an embedded bus deaf to other groups of this machine, and give it room for bursts.

    Its scope (IPv6: interface-local) and its hop limit of 0 keep what it sends on this machine.
    """
    with socket.socket(fileno=os.dup(bus.fileno())) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
        if ":" in group:
            sock.setsockopt(socket.IPPROTO_IPV6, _IPV6_MULTICAST_ALL, 0)
        else:
            sock.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)


def _frame(message: can.Message) -> CanFrame:
    return CanFrame(
        message.arbitration_id,
        bytes(message.data),
        message.is_extended_id,
        message.is_error_frame,
        message.is_remote_frame,
        time.monotonic_ns(),
    )


def _mend(address: BusAddress) -> str:
    if address.interface == "socketcan":
        name = address.channel
        kind = (
            f"sudo ip link add dev {name} type vcan && sudo ip link set {name} up"
            if name.startswith("vcan")
            else f"sudo ip link set {name} up type can bitrate 1000000"
        )
        return f"try: {kind}"
    return "check the [bus] table of the configuration"
