"""Lines over a stream socket, never waiting: what cannot be sent yet is kept, what has not fully come is kept."""

from __future__ import annotations

import math
import select
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import socket

_CHUNK = 65536
_LONGEST_LINE = 64 * 2**20
"""Bytes; no table is nearly as large, so a longer line is a broken peer."""


class Lines:
    """One end of a connection that carries lines; `ended` once the other end is gone."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        self._connection = connection
        self._outgoing = bytearray()
        self._incoming = bytearray()
        self.ended = False

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._connection.fileno()

    @property
    def pending(self) -> bool:
        """True while something waits to be sent."""
        return bool(self._outgoing)

    def wait(self, timeout_s: float | None) -> None:
        """Wait until there is something to receive, or to send what is pending, or `timeout_s` is over."""
        poll = select.poll()
        poll.register(self._connection, select.POLLIN | (select.POLLOUT if self._outgoing else 0))
        poll.poll(None if timeout_s is None else math.ceil(1000.0 * timeout_s))

    def send(self, line: bytes) -> None:
        """Queue a line and send what can be sent now."""
        self._outgoing += line + b"\n"
        self.flush()

    def flush(self) -> None:
        """Send what can be sent now."""
        try:
            while self._outgoing:
                del self._outgoing[: self._connection.send(self._outgoing)]
        except BlockingIOError:
            pass
        except OSError:
            self._outgoing.clear()  # incoming lines may still be there to be read, up to the end

    def receive(self) -> list[bytes]:
        """Return the complete lines that have come."""
        if self.ended:
            return []
        before = len(self._incoming)
        try:
            while chunk := self._connection.recv(_CHUNK):
                self._incoming += chunk
                if len(self._incoming) > _LONGEST_LINE:
                    break
            self.ended = True
        except BlockingIOError:
            if len(self._incoming) == before:
                return []  # the usual case, in every cycle
        except OSError:
            self.ended = True
        *complete, self._incoming = self._incoming.split(b"\n")
        return [bytes(line) for line in complete]

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()
