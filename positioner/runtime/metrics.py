"""The daemon's side of its metrics: from time to time a snapshot of every valve goes to the metrics writer. Shell.

Nothing of it is on the way of a cycle: the daemon calls it where it reports life to the service manager, ten times a
second. A snapshot that the metrics writer cannot take at once is dropped.
"""

from __future__ import annotations

import json
import socket
import subprocess
import time
from typing import TYPE_CHECKING

import positioner
from positioner.machine.journal import logger
from positioner.metrics.snapshot import MOST_BYTES, snapshot_of
from positioner.store.interpreter import beyond_standard, shielded

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.config.schema import Configuration
    from positioner.metrics.settings import MetricsSettings
    from positioner.runtime.session import Session

PROGRAM = "positioner.metrics.writer"
_CLOSE_S = 1.0


class Metrics:
    """The metrics of the valves that share their places."""

    def __init__(self, settings: MetricsSettings, sessions: Sequence[Session]) -> None:
        """Start the metrics writer; where that fails, a line of the log says so, and there are no metrics."""
        self._sessions = tuple(sessions)
        self._every_s, self._due_s = settings.every_s, 0.0
        self._channel: socket.socket | None
        self._channel, theirs = (
            socket.socket(fileno=beyond_standard(end.detach()))
            for end in socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        )
        self._channel.setblocking(False)
        self._channel.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, MOST_BYTES)
        places = ("" if each is None else str(each.absolute()) for each in (settings.file, settings.socket))
        arguments = (str(theirs.fileno()), *places, positioner.__version__)
        try:
            self._process = shielded(PROGRAM, *arguments, descriptors=(theirs.fileno(),))
        except OSError as error:
            self._end(f"the metrics writer cannot be started: {error}")
        finally:
            theirs.close()

    def look(self, now_s: float) -> None:
        """Hand over at the monotonic instant `now_s`, where that is due; never waits, never raises."""
        if now_s < self._due_s or self._channel is None:
            return
        self._due_s = now_s + self._every_s
        unix_s = time.time()
        try:
            snapshots = [
                snapshot_of(each.setup.valve, each.state, each.health.state, unix_s) for each in self._sessions
            ]
            self._channel.send(json.dumps(snapshots).encode())
        except BlockingIOError:
            pass  # it has not taken the last ones yet
        except Exception as error:  # noqa: BLE001 - a defect here must never end a control loop
            self._end(f"the metrics writer is gone ({error}): no metrics until the positioner starts again")

    def close(self) -> None:
        """End the metrics writer, and with it its file and its socket."""
        if self._channel is None:
            return
        self._channel.close()
        try:
            self._process.wait(_CLOSE_S)
        except subprocess.TimeoutExpired:
            logger.warning("metrics: the metrics writer does not end; its disk may hang")

    def _end(self, reason: str) -> None:
        logger.warning("metrics: %s", reason)
        if self._channel is not None:
            self._channel.close()
        self._channel = None


def metrics_of(configurations: Sequence[Configuration], sessions: Sequence[Session]) -> tuple[Metrics, ...]:
    """Return the metrics of a daemon: one for all valves that share their places, none where none are wanted."""
    by_place: dict[MetricsSettings, list[Session]] = {}
    for configuration, session in zip(configurations, sessions, strict=True):
        if configuration.metrics.is_on:
            by_place.setdefault(configuration.metrics, []).append(session)
    return tuple(Metrics(settings, some) for settings, some in by_place.items())
