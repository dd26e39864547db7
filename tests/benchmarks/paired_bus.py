"""A CAN bus between two processes that is one connection of local sockets: the least that a bus can cost."""

from __future__ import annotations

import select
import socket
import struct
import time
from typing import TYPE_CHECKING

import can

if TYPE_CHECKING:
    from collections.abc import Callable

_FRAME = struct.Struct("=IB3x8s")
"""Identifier, length and data, as in struct can_frame of linux/can.h."""
_LARGEST_STANDARD = 0x7FF


class PairedBus(can.BusABC):
    """One end of the connection, for python-can."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        super().__init__(channel="")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame; there is always room for one."""
        del timeout
        self._end.send(_FRAME.pack(msg.arbitration_id, msg.dlc, bytes(msg.data)))

    def fileno(self) -> int:
        """Return the descriptor that is readable once a frame has come."""
        return self._end.fileno()

    def shutdown(self) -> None:
        """Close this end."""
        super().shutdown()
        self._end.close()

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not select.select([self._end], [], [], timeout)[0]:
            return None, False
        identifier, length, data = _FRAME.unpack(self._end.recv(_FRAME.size))
        extended = identifier > _LARGEST_STANDARD
        return can.Message(time.time(), identifier, extended, data=data[:length], check=False), False


def joined(path: str) -> Callable[[object, object], can.BusABC]:
    """Return what opens the bus whose other end listens at `path`, in place of `positioner.bus.opening.open_bus`."""

    def open_bus(address: object, wanted: object) -> can.BusABC:
        del address, wanted
        end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        end.connect(path)
        return PairedBus(end)

    return open_bus
