"""Messages over a stream socket, without waiting: a channel keeps lines that are not yet sent or not yet complete."""

from __future__ import annotations

import math
import select
import time
from collections import deque
from typing import TYPE_CHECKING

from positioner.errors import StateError
from positioner.store import messages

if TYPE_CHECKING:
    import socket
    from collections.abc import Iterator

_CHUNK = 65536
_LONGEST_LINE = 64 * 2**20
"""Bytes; no table is nearly as large, so a longer line comes from a broken peer."""


class Channel:
    """One end of a connection that carries messages.

    A message is written and read line by line: a call that limits the number of lines is short, even for a large table.
    """

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        self._connection = connection
        self._to_write: deque[Iterator[bytes]] = deque()
        self._outgoing = bytearray()
        self._incoming = bytearray()
        self._to_read: deque[bytes] = deque()
        self._decoder = messages.Decoder()
        self._hung_up = False

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._connection.fileno()

    @property
    def pending(self) -> bool:
        """True while something waits to be sent."""
        return bool(self._outgoing or self._to_write)

    @property
    def ended(self) -> bool:
        """True once the other end is gone, and all that it sent has been received."""
        return self._hung_up and not self._to_read

    def send(self, message: messages.Message) -> None:
        """Queue a message for `flush`."""
        self._to_write.append(messages.lines(message))

    def flush(self, most_lines: int | None = None) -> None:
        """Send what can be sent now, at most `most_lines` lines; None sets no limit."""
        lines = 0
        try:
            while True:
                while self._outgoing:
                    del self._outgoing[: self._connection.send(self._outgoing)]
                if not self._to_write or lines == most_lines:
                    return
                line = next(self._to_write[0], None)
                if line is None:
                    self._to_write.popleft()
                else:
                    self._outgoing += line + b"\n"
                    lines += 1
        except BlockingIOError:
            pass
        except OSError:  # the other end is gone; its last messages may still be received
            self._outgoing.clear()
            self._to_write.clear()

    def receive(self, most_lines: int | None = None) -> list[messages.Message]:
        """Return the messages that have come in at most `most_lines` lines; `Unreadable` for a line that is none."""
        self._read()
        found = []
        for _ in range(len(self._to_read) if most_lines is None else min(most_lines, len(self._to_read))):
            try:
                message = self._decoder.feed(self._to_read.popleft())
            except StateError as error:
                message = messages.Unreadable(str(error))
            if message is not None:
                found.append(message)
        return found

    def wait(self, timeout_s: float) -> None:
        """Wait until there is something to receive, or to send what is pending, or `timeout_s` is over."""
        poll = select.poll()
        poll.register(self._connection, select.POLLIN | (select.POLLOUT if self.pending else 0))
        poll.poll(None if timeout_s == math.inf else math.ceil(1000.0 * timeout_s))

    def received_until(self, deadline_s: float) -> Iterator[messages.Message]:
        """Send what is pending, and yield messages as they come, until a monotonic instant or the other end is gone."""
        while (left_s := deadline_s - time.monotonic()) > 0.0 and not self.ended:
            self.flush()
            if not self._to_read:
                self.wait(left_s)
            yield from self.receive(most_lines=1)

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    def _read(self) -> None:
        if self._hung_up:
            return
        before = len(self._incoming)
        try:
            while chunk := self._connection.recv(_CHUNK):
                self._incoming += chunk
                if len(self._incoming) > _LONGEST_LINE:
                    break
            self._hung_up = True
        except BlockingIOError:
            if len(self._incoming) == before:
                return  # the usual case, in every cycle
        except OSError:
            self._hung_up = True
        *complete, self._incoming = self._incoming.split(b"\n")
        self._to_read.extend(map(bytes, complete))
