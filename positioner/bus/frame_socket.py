"""A bus by its socket: each frame is read into one buffer and taken from it, without the objects of python-can. Shell.

python-can opens the socket, sets its filters and closes it. Buses that are no socket keep python-can's own calls.
"""

from __future__ import annotations

import os
import select
import socket
import struct
from typing import TYPE_CHECKING, Any, TypeAlias

import msgpack
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.udp_multicast import UdpMulticastBus

from positioner.bus.raw_frame import ROOM_WITHIN_S, NoFrameError

if TYPE_CHECKING:
    from collections.abc import Callable

    import can

    from positioner.bus.address import BusAddress
    from positioner.bus.raw_frame import RawFrame
    from positioner.wire.messages import CanFrame

_Fields: TypeAlias = tuple[int, bytes, bool, bool, bool]

_CAN = struct.Struct("=IB3x8s")
"""struct can_frame of linux/can.h."""
_EXTENDED, _REMOTE, _ERROR, _EXTENDED_ID, _STANDARD_ID = 0x80000000, 0x40000000, 0x20000000, 0x1FFFFFFF, 0x7FF
_STAMP = struct.Struct("@ll")
_ANCILLARY_BYTES = socket.CMSG_SPACE(_STAMP.size)
_LARGEST = 4096


class FrameSocket:
    """Receives and sends frames on the socket of a bus; `unpack` and `pack` know their form in its datagrams."""

    def __init__(
        self,
        bus: can.BusABC,
        unpack: Callable[[memoryview], _Fields],
        pack: Callable[[CanFrame], bytes],
        destination: tuple[str, int] | None = None,
    ) -> None:
        """Use the socket of `bus`, which stays open by itself."""
        self._socket = socket.socket(fileno=os.dup(bus.fileno()))
        self._unpack, self._pack, self._destination = unpack, pack, destination
        self._view = memoryview(bytearray(_LARGEST))
        self._buffers = [self._view]

    def receive(self, timeout_s: float) -> RawFrame | None:
        """Return the next frame, None if none comes within `timeout_s`.

        Raises:
            NoFrameError: what came is none.
            OSError: the bus does not work.
        """
        if timeout_s > 0.0 and not select.select((self._socket,), (), (), timeout_s)[0]:
            return None
        try:
            count, ancillary, _, _ = self._socket.recvmsg_into(self._buffers, _ANCILLARY_BYTES, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return None
        stamp_s = 0.0
        if ancillary:
            seconds, nanoseconds = _STAMP.unpack_from(ancillary[0][2])
            stamp_s = seconds + nanoseconds * 1e-9
        return (*self._unpack(self._view[:count]), stamp_s)

    def send(self, frame: CanFrame, room_within_s: float = ROOM_WITHIN_S) -> None:
        """Send `frame`.

        Raises:
            OSError: the bus does not take it, or has no room for too long.
        """
        data = self._pack(frame)
        try:
            self._send(data)
        except BlockingIOError:
            select.select((), (self._socket,), (), room_within_s)
            self._send(data)

    def _send(self, data: bytes) -> None:
        if self._destination is None:
            self._socket.send(data, socket.MSG_DONTWAIT)
        else:
            self._socket.sendto(data, socket.MSG_DONTWAIT, self._destination)

    def close(self) -> None:
        """Close this descriptor of the socket."""
        self._socket.close()


def socket_of(bus: can.BusABC, address: BusAddress) -> FrameSocket | None:
    """Return the socket of `bus`, None where frames are not read from one."""
    if isinstance(bus, SocketcanBus):
        return FrameSocket(bus, _from_can, _to_can)
    if isinstance(bus, UdpMulticastBus):
        return FrameSocket(bus, _from_msgpack, _to_msgpack, (address.channel, address.port))
    return None


def _from_can(view: memoryview) -> _Fields:
    if len(view) != _CAN.size:
        raise NoFrameError(f"{len(view)} bytes are no classic CAN frame")
    flags, length, data = _CAN.unpack_from(view)
    extended = bool(flags & _EXTENDED)
    identifier = flags & (_EXTENDED_ID if extended else _STANDARD_ID)
    return identifier, data[:length], extended, bool(flags & _ERROR), bool(flags & _REMOTE)


def _to_can(frame: CanFrame) -> bytes:
    flags = (_EXTENDED if frame.is_extended else 0) | (_REMOTE if frame.is_remote else 0)
    return _CAN.pack(frame.arbitration_id | flags, len(frame.data), frame.data)


def _from_msgpack(view: memoryview) -> _Fields:
    try:
        fields: dict[str, Any] = msgpack.unpackb(view)
        return (
            int(fields["arbitration_id"]),
            bytes(fields["data"] or b""),
            bool(fields["is_extended_id"]),
            bool(fields["is_error_frame"]),
            bool(fields["is_remote_frame"]),
        )
    except Exception as error:  # msgpack raises many kinds
        raise NoFrameError(f"{type(error).__name__}: {error}") from error


def _to_msgpack(frame: CanFrame) -> bytes:
    """Return the datagram as python-can packs it."""
    packed: bytes = msgpack.packb(
        {
            "timestamp": 0.0,
            "arbitration_id": frame.arbitration_id,
            "is_extended_id": frame.is_extended,
            "is_remote_frame": False,
            "is_error_frame": False,
            "channel": None,
            "dlc": len(frame.data),
            "data": frame.data,
            "is_fd": False,
            "bitrate_switch": False,
            "error_state_indicator": False,
        }
    )
    return packed
