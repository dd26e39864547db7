"""The keeper's process, as its parent holds it."""

from __future__ import annotations

import signal
import socket
import subprocess
import time
from dataclasses import dataclass

from positioner.errors import StateError
from positioner.store import messages
from positioner.store.interpreter import beyond_standard, command, environment
from positioner.store.lines import Lines

PROGRAM = "positioner.store.keeper"
"""The module that runs as the keeper; tests put one with a failing disk in its place."""
_START_S = 30.0
_SHIELDED = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}


@dataclass(frozen=True, slots=True)
class Child:
    """The keeper's process and the daemon's end of the channel to it."""

    process: subprocess.Popen[bytes]
    channel: Lines

    def send(self, message: messages.ToKeeper) -> None:
        """Queue a message."""
        self.channel.send(messages.encode(message))

    def heard(self) -> list[messages.Message]:
        """Return the messages that have come; after one that cannot be understood the channel counts as ended."""
        try:
            return [messages.decode(line) for line in self.channel.receive()]
        except StateError:
            self.channel.ended = True
            return []

    def end(self) -> None:
        """Kill the process, and return when it is gone."""
        self.channel.close()
        self.process.kill()
        self.process.wait()


def start(lock_descriptor: int, opening: messages.Open) -> Child:
    """Return the keeper, started but not waited for, with its first message on the way.

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
    """Return the keeper's first answer, and what came with it: a first save may already have failed.

    Raises:
        StateError: there is none, or it is a refusal.
    """
    deadline_s = time.monotonic() + _START_S
    reason = "the keeper of the stiction table does not start"
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
