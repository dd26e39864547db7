"""Lines to a stream that nobody may read any more: a line that would have to wait is dropped and counted. Shell.

A pipe, a socket (journald's) or a terminal takes nothing more once it is full, and a plain write then waits until it is
read. Whether it waits is a property of the open file, which other processes share, so it is not changed here: a socket
is asked not to wait for this one message, any other file is opened a second time for this process alone. Regular files
never wait.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import stat
import time
from functools import partial
from typing import TYPE_CHECKING, Self, TextIO, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Callable

    _Write: TypeAlias = Callable[[bytes], int]
    _Close: TypeAlias = Callable[[], None]

PIPE_BUF = select.PIPE_BUF
"""Bytes that a pipe takes whole or not at all; a longer line is cut, unless it may wait."""
_CUT = "…\n".encode()


class LineSink:
    """Takes lines, and waits only where a timeout is given; `dropped` counts the lines that nobody took."""

    def __init__(self, descriptor: int, write: _Write, close: _Close) -> None:
        """Write with `write`, which takes some bytes or raises OSError; `descriptor` can be waited for."""
        self._descriptor = descriptor
        self._write = write
        self.close = close
        self._pending = b""
        self._missing = 0
        self.dropped = 0

    @classmethod
    def of(cls, stream: TextIO) -> Self:
        """Return a sink for the file of `stream`."""
        try:
            descriptor = stream.fileno()
        except (OSError, ValueError):  # no file at all, as in a test

            def to_text(data: bytes) -> int:
                with contextlib.suppress(ValueError):  # closed meanwhile
                    stream.write(data.decode())
                return len(data)

            return cls(-1, to_text, _keep_open)
        return cls(descriptor, *_writer_of(descriptor))

    def write(self, line: str, timeout_s: float = 0.0) -> None:
        """Write a line, waiting no longer than `timeout_s`; the first one after a gap says how many are missing."""
        deadline_s = time.monotonic() + timeout_s
        gap = f"WARNING {self._missing} line(s) of the log are missing here: it was not read\n"
        data = f"{gap if self._missing else ''}{line}\n".encode("utf-8", "backslashreplace")
        if len(data) > PIPE_BUF and not timeout_s:
            data = data[: PIPE_BUF - len(_CUT)].decode("utf-8", "ignore").encode() + _CUT
        if self._flush(deadline_s) and self._take(data, deadline_s):
            self._missing = 0
        else:
            self._missing += 1
            self.dropped += 1

    def _take(self, data: bytes, deadline_s: float) -> bool:
        """Return whether any of `data` was taken; the rest of it then goes before the next line."""
        self._pending = data
        self._flush(deadline_s)
        if len(self._pending) == len(data):
            self._pending = b""
            return False
        return True

    def _flush(self, deadline_s: float) -> bool:
        """Write the pending bytes; return whether none are left."""
        while self._pending:
            try:
                self._pending = self._pending[self._write(self._pending) :]
            except BlockingIOError:
                left_s = deadline_s - time.monotonic()
                if left_s <= 0.0 or not _is_writable(self._descriptor, left_s):
                    return False
            except OSError:  # the reader has gone, or the disk is full
                return False
        return True


def _writer_of(descriptor: int) -> tuple[_Write, _Close]:
    """Return the function that writes at once or raises OSError (BlockingIOError if it would wait), and the `close`."""
    kind = os.fstat(descriptor).st_mode
    if stat.S_ISREG(kind):
        return partial(os.write, descriptor), _keep_open
    if stat.S_ISSOCK(kind):
        connection = socket.socket(fileno=os.dup(descriptor))
        return (lambda data: connection.send(data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)), connection.close
    try:
        own = os.open(f"/proc/self/fd/{descriptor}", os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
    except OSError:  # another user's terminal, or no /proc; poll() promises room for PIPE_BUF in a pipe, or one byte
        most = PIPE_BUF if stat.S_ISFIFO(kind) else 1

        def write(data: bytes) -> int:
            if not _is_writable(descriptor, 0.0):
                raise BlockingIOError
            return os.write(descriptor, data[:most])

        return write, _keep_open
    return partial(os.write, own), partial(os.close, own)


def _keep_open() -> None:
    """Do nothing: the file belongs to others, too."""


def _is_writable(descriptor: int, timeout_s: float) -> bool:
    """Return whether the file takes bytes, after waiting up to `timeout_s` for it."""
    poll = select.poll()
    poll.register(descriptor, select.POLLOUT)
    return bool(poll.poll(1000.0 * timeout_s))
