"""The table writer's process: its parent starts it, receives its first answer, and may kill it."""

from __future__ import annotations

import socket
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.errors import StateError
from positioner.store import messages
from positioner.store.channel import Channel
from positioner.store.interpreter import beyond_standard, shielded

if TYPE_CHECKING:
    import subprocess

PROGRAM = "positioner.store.writer"
"""The module that runs as the table writer; tests put one with a failing disk in its place."""
_START_S = 30.0


@dataclass(frozen=True, slots=True)
class Child:
    """The process, and the daemon's end of the channel to it."""

    process: subprocess.Popen[bytes]
    channel: Channel

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
    try:
        process = shielded(PROGRAM, *map(str, descriptors), descriptors=descriptors)
    except OSError:
        ours.close()
        raise
    finally:
        theirs.close()
    child = Child(process, Channel(ours))
    child.channel.send(opening)
    child.channel.flush()
    return child


def opened(child: Child) -> messages.Opened:
    """Return the table writer's first answer.

    Raises:
        StateError: no answer came, or the answer is a refusal.
    """
    reason = "the table writer does not start"
    for message in child.channel.received_until(time.monotonic() + _START_S):
        if isinstance(message, messages.Opened):
            return message
        if isinstance(message, messages.Closed):
            reason = str(message.problem)
    child.end()
    raise StateError(reason)
