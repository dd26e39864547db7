"""The daemon's side of its metrics: from time to time a snapshot of every valve goes to the metrics writer. Shell.

Nothing of it is on the way of a cycle: the daemon calls it where it reports life to the service manager, ten times a
second, when the commands of its cycle are sent. A snapshot that the metrics writer cannot take at once is dropped. A
metrics writer that ended is started again, after growing intervals.
"""

from __future__ import annotations

import json
import math
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
_FIRST_S, _LONGEST_S = 1.0, 300.0
"""From the end of a metrics writer to its next start: each time twice as long."""
_STEADY_S = 600.0
"""A metrics writer that has lived so long begins anew with the first interval, and its end is told again."""


class Metrics:
    """The metrics of the valves that share their places."""

    def __init__(self, settings: MetricsSettings, sessions: Sequence[Session]) -> None:
        """Start the metrics writer; where that fails, `look` tells it and tries again."""
        self._sessions = tuple(sessions)
        self._every_s, self._due_s = settings.every_s, 0.0
        self._places = ["" if each is None else str(each.absolute()) for each in (settings.file, settings.socket)]
        self._channel: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._started_s, self._again_s, self._is_told = 0.0, _FIRST_S, False
        self._start()

    def look(self, now_s: float) -> None:
        """Hand over at the monotonic instant `now_s`, where that is due; never waits, never raises."""
        if now_s < self._due_s:
            return
        self._due_s = now_s + self._every_s
        try:
            problem = None
            if self._channel is None:
                problem, self._started_s = self._start(), now_s
            if problem := problem or self._hand_over():
                self._try_later(now_s, problem)
        except Exception as error:  # noqa: BLE001 - a defect here must never end a control loop
            logger.warning("metrics: no more until the positioner starts again: %s", error)
            self._due_s = math.inf

    def close(self) -> None:
        """End the metrics writer, and with it its file and its socket."""
        if self._channel is None or self._process is None:
            return
        self._channel.close()
        try:
            self._process.wait(_CLOSE_S)
        except subprocess.TimeoutExpired:
            logger.warning("metrics: the metrics writer does not end; its disk may hang")

    def _start(self) -> str | None:
        """Start the metrics writer once the last one is surely gone, for two would share a file; return a problem."""
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            return "the last metrics writer does not end"
        ours, theirs = (
            socket.socket(fileno=beyond_standard(end.detach()))
            for end in socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        )
        ours.setblocking(False)
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, MOST_BYTES)
        arguments = (str(theirs.fileno()), *self._places, positioner.__version__)
        try:
            self._process = shielded(PROGRAM, *arguments, descriptors=(theirs.fileno(),))
        except OSError as error:
            ours.close()
            return f"the metrics writer cannot be started: {error}"
        finally:
            theirs.close()
        self._channel = ours
        return None

    def _hand_over(self) -> str | None:
        """Send a snapshot of each valve; return why nobody takes it any more, or None."""
        if self._channel is None:
            return None
        unix_s = time.time()
        snapshots = [
            snapshot_of(
                each.setup.valve, each.state, each.health.state, unix_s, each.shadow.total if each.shadow else None
            )
            for each in self._sessions
        ]
        try:
            self._channel.send(json.dumps(snapshots).encode())
        except BlockingIOError:
            pass  # it has not taken the last ones yet
        except ConnectionError:
            return "the metrics writer has ended"
        return None

    def _try_later(self, now_s: float, problem: str) -> None:
        """Let the next start come later than the one before, and tell the first of several problems."""
        if self._channel is not None:
            self._channel.close()
            self._channel = None
        if now_s - self._started_s > _STEADY_S:
            self._again_s, self._is_told = _FIRST_S, False
        if not self._is_told:
            text = "metrics: %s; it is started again in %g s, and where it ends again, ever later, up to %g s"
            logger.warning(text, problem, self._again_s, _LONGEST_S)
        self._is_told = True
        self._due_s = now_s + self._again_s
        self._again_s = min(2.0 * self._again_s, _LONGEST_S)


def metrics_of(configurations: Sequence[Configuration], sessions: Sequence[Session]) -> tuple[Metrics, ...]:
    """Return the metrics of a daemon: one for all valves that share their places, none where none are wanted."""
    by_place: dict[MetricsSettings, list[Session]] = {}
    for configuration, session in zip(configurations, sessions, strict=True):
        if configuration.metrics.is_on:
            by_place.setdefault(configuration.metrics, []).append(session)
    return tuple(Metrics(settings, some) for settings, some in by_place.items())
