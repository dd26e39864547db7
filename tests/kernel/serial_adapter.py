"""A serial CAN adapter (SLCAN, as CANable and Lawicel speak it) on a pseudo-terminal: `can0` on this machine.

The kernel's own slcan driver is on the near end; what it sends goes to a virtual CAN bus, and back.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import select
import socket
import struct
import termios
import threading
import tty
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from types import TracebackType

_N_SLCAN = 17
_FRAME = struct.Struct("=IB3x8s")
_STANDARD_DIGITS = 3


class SerialAdapter:
    """While it is plugged in, `can0` exists, and its other side is the bus `wire`."""

    def __init__(self, wire: str) -> None:
        self._leader, self._follower = pty.openpty()
        tty.setraw(self._follower)
        self._bus = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self._bus.bind((wire,))
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self.other_lines: list[bytes] = []

    def __enter__(self) -> Self:
        self._thread.start()
        fcntl.ioctl(self._follower, termios.TIOCSETD, struct.pack("i", _N_SLCAN))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopping.set()
        self._thread.join(5.0)
        for descriptor in (self._follower, self._leader):
            with contextlib.suppress(OSError):
                os.close(descriptor)
        self._bus.close()

    def _carry(self) -> None:
        pending = b""
        while not self._stopping.is_set():
            ready, _, _ = select.select([self._leader, self._bus.fileno()], [], [], 0.1)
            if self._bus.fileno() in ready:
                os.write(self._leader, _line(self._bus.recv(_FRAME.size)))
            if self._leader in ready:
                *lines, pending = (pending + os.read(self._leader, 4096)).split(b"\r")
                for line in lines:
                    if line[:1] == b"t":
                        self._bus.send(_frame(line))
                    else:
                        self.other_lines.append(line)


def _line(frame: bytes) -> bytes:
    identifier, length, data = _FRAME.unpack(frame)
    return b"t%03X%d%s\r" % (identifier & 0x7FF, length, data[:length].hex().upper().encode())


def _frame(line: bytes) -> bytes:
    identifier, length = int(line[1 : 1 + _STANDARD_DIGITS], 16), int(line[4:5])
    return _FRAME.pack(identifier, length, bytes.fromhex(line[5 : 5 + 2 * length].decode()).ljust(8, b"\0"))
