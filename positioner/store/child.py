"""The table writer's process, as its parent holds it."""

from __future__ import annotations

import signal
import socket
import subprocess
import time
from collections import deque
from typing import TYPE_CHECKING

from positioner.errors import StateError
from positioner.store import messages
from positioner.store.interpreter import beyond_standard, command, environment
from positioner.store.lines import Lines

if TYPE_CHECKING:
    from collections.abc import Iterator

PROGRAM = "positioner.store.writer"
"""The module that runs as the table writer; tests put one with a failing disk in its place."""
_START_S = 30.0
_SHIELDED = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}


class Child:
    """The table writer's process and the daemon's end of the channel to it."""

    def __init__(self, process: subprocess.Popen[bytes], channel: Lines) -> None:
        """Take the process and the channel over."""
        self.process = process
        self.channel = channel
        self._decoder = messages.Decoder()
        self._unread: deque[bytes] = deque()
        self._unsent: Iterator[bytes] = iter(())
        self._sends = False

    @property
    def busy(self) -> bool:
        """True while something waits to be sent."""
        return self._sends or self.channel.pending

    @property
    def ended(self) -> bool:
        """True once the process is gone and all that it said has been heard."""
        return self.channel.ended and not self._unread

    def send(self, message: messages.ToWriter) -> None:
        """Queue a message, behind the rest of one that was begun."""
        for line in (*self._unsent, *messages.lines(message)):
            self.channel.send(line)
        self._sends = False

    def begin(self, message: messages.ToWriter) -> None:
        """Queue a message that `work` writes and sends a few lines at a time."""
        self._unsent, self._sends = messages.lines(message), True

    def work(self, most_lines: int) -> None:
        """Send what can be sent now, and of a message that was begun no more than `most_lines`."""
        self.channel.flush()
        for _ in range(most_lines if self._sends and not self.channel.pending else 0):
            line = next(self._unsent, None)
            if line is None:
                self._sends = False
                return
            self.channel.send(line)

    def heard(self, most_lines: int | None = None) -> list[messages.Message]:
        """Return the messages in the lines that have come, in at most so many of them.

        After one that cannot be understood the channel counts as ended.
        """
        self._unread.extend(self.channel.receive())
        number = len(self._unread) if most_lines is None else min(most_lines, len(self._unread))
        try:
            found = [self._decoder.feed(self._unread.popleft()) for _ in range(number)]
        except StateError:
            self._unread.clear()
            self.channel.ended = True
            return []
        return [message for message in found if message is not None]

    def end(self) -> None:
        """Kill the process, and return when it is gone."""
        self.channel.close()
        self.process.kill()
        self.process.wait()


def start(lock_descriptor: int, opening: messages.Open) -> Child:
    """Return the table writer, started but not waited for, with its first message on the way.

    Raises:
        OSError: it cannot be started.
    """
    ours, theirs = (socket.socket(fileno=beyond_standard(end.detach())) for end in socket.socketpair())
    descriptors = theirs.fileno(), lock_descriptor
    # Blocked signals stay blocked in the child: Ctrl-C or a stop of the whole service must not end it first.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, _SHIELDED)
    try:
        process = subprocess.Popen(  # noqa: S603, our own interpreter and module
            command(PROGRAM, *map(str, descriptors)),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=descriptors,
            env=environment(),
        )
    except OSError:
        ours.close()
        raise
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        theirs.close()
    child = Child(process, Lines(ours))
    child.send(opening)
    return child


def opened(child: Child) -> tuple[messages.Opened, tuple[messages.Message, ...]]:
    """Return the table writer's first answer, and what came with it: a first save may already have failed.

    Raises:
        StateError: there is none, or it is a refusal.
    """
    deadline_s = time.monotonic() + _START_S
    reason = "the table writer does not start"
    while (left_s := deadline_s - time.monotonic()) > 0.0 and not child.channel.ended:
        child.channel.wait(left_s)
        child.channel.flush()
        heard = child.heard()
        for number, message in enumerate(heard, 1):
            if isinstance(message, messages.Opened):
                return message, tuple(heard[number:])
            if isinstance(message, messages.Closed):
                reason = str(message.problem)
    child.end()
    raise StateError(reason)
