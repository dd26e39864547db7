"""The metrics writer: the process that keeps a daemon's newest metrics, writes their file and answers at their socket.

The daemon hands snapshots over and never waits. When its end of the channel closes, however the daemon ended, file and
socket go: nobody shall take old metrics for new ones. What others have put in their place stays. Shell.
"""

from __future__ import annotations

import errno
import json
import os
import socket
import sys
import tempfile
import threading
import time
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from socketserver import ThreadingUnixStreamServer
from typing import Any, ClassVar

from positioner.errors import in_one_line
from positioner.metrics.exposition import CONTENT_TYPE, text_of
from positioner.metrics.places import Identity, file_problem, identity_of, socket_problem
from positioner.metrics.snapshot import MOST_BYTES

_FILE_MODE, _SOCKET_MODE = 0o644, 0o666
"""Metrics are no secret, and their readers are other users; who may reach them the folder says."""
_PATIENCE_S = 5.0
"""How long one client may take in all, from its connection to the end of the answer."""
MOST_CLIENTS = 16
"""Clients at a time. Each takes a thread and a descriptor, of which a process has 1024; a scrape takes milliseconds."""


class Problems:
    """Says once what is wrong, and once that it is over."""

    def __init__(self) -> None:
        """Begin with nothing wrong."""
        self._told: str | None = None

    def tell(self, problem: str | None) -> None:
        """Write a line of the log where the problem is not that of before."""
        if problem == self._told:
            return
        line = f"WARNING metrics: {problem}" if problem else "INFO metrics: written again"
        self._told = problem
        with suppress(OSError, ValueError):
            sys.stderr.write(f"{in_one_line(line)}\n")
            sys.stderr.flush()


class MetricsFile:
    """The file of the metrics: nothing but metrics of ours is replaced, and nothing but this file is removed."""

    def __init__(self, path: Path) -> None:
        """Begin without a text; what a daemon before this one has left may stand there."""
        self.path = path
        self._own: Identity | None = None

    def write(self, text: str) -> str | None:
        """Put the text in place of the file, all at once; return why that failed, or None."""
        if problem := self._refusal():
            return f"{self.path}: {problem}; tried again each time"
        new: str | None = None
        try:
            descriptor, new = tempfile.mkstemp(".new", f".{self.path.name}.", self.path.parent)
            with os.fdopen(descriptor, "w", encoding="utf-8") as file:
                os.fchmod(descriptor, _FILE_MODE)
                file.write(text)
            own = identity_of(Path(new))  # after the last byte: it holds the instant of the last change
            os.replace(new, self.path)  # noqa: PTH105 - one string, as mkstemp gives it
        except OSError as error:
            if new is not None:
                with suppress(OSError):
                    os.unlink(new)  # noqa: PTH108
            return f"{self.path}: cannot be written: {error.strerror}; tried again each time"
        self._own = own
        return None

    def remove(self) -> None:
        """Remove the file, if it is still the one that was written last."""
        _remove(self.path, self._own)

    def _refusal(self) -> str | None:
        """Return why what has the name now must stay, or None."""
        now = identity_of(self.path)
        if self._own is not None and now not in {None, self._own}:
            return "another process writes there, too"
        return None if now is not None and now == self._own else file_problem(self.path)


def _remove(path: Path, own: Identity | None) -> None:
    """Remove what has this name, if it is `own`."""
    if own is not None and identity_of(path) == own:
        with suppress(OSError):
            path.unlink()


class _Handler(BaseHTTPRequestHandler):
    """One request at the socket."""

    server: MetricsSocket
    timeout: ClassVar[float] = _PATIENCE_S

    def do_GET(self) -> None:
        """Answer with the newest metrics."""
        if self.path not in {"/", "/metrics"}:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        body = self.server.text.encode()
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", CONTENT_TYPE)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def address_string(self) -> str:
        """Return the name of the asker: a Unix socket knows none."""
        return "local"

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - as the base class names it
        """Say nothing."""


class MetricsSocket(ThreadingUnixStreamServer):
    """Answers HTTP at a Unix socket with `text`."""

    daemon_threads = True
    block_on_close = False

    request_queue_size = MOST_CLIENTS

    def __init__(self, path: Path) -> None:
        """Make the socket; one that is left over from before goes.

        Raises:
            OSError: it cannot be made, something else has its name, or another process answers there.
        """
        if problem := socket_problem(path):
            raise FileExistsError(errno.EEXIST, problem, str(path))
        path.unlink(missing_ok=True)
        super().__init__(str(path), _Handler)
        self._path, self._own = path, identity_of(path)
        path.chmod(_SOCKET_MODE)
        self.text = "# EOF\n"
        self._clients: dict[socket.socket, float] = {}

    def verify_request(self, request: Any, client_address: object) -> bool:
        """Answer no more clients than `MOST_CLIENTS` at a time; another one is closed at once."""
        del client_address
        if len(self._clients) >= MOST_CLIENTS:
            return False
        self._clients[request] = time.monotonic()
        return True

    def service_actions(self) -> None:
        """End the clients that have not asked, or not taken the answer, in their time; the server calls it often."""
        since_s = time.monotonic() - _PATIENCE_S
        for client, began_s in tuple(self._clients.items()):
            if began_s < since_s:
                with suppress(OSError):
                    client.shutdown(socket.SHUT_RDWR)

    def shutdown_request(self, request: Any) -> None:
        """Close a client, so that another one has its place."""
        self._clients.pop(request, None)
        super().shutdown_request(request)

    def close(self) -> None:
        """End; then remove the socket, if it is still the one that was made here."""
        self.shutdown()
        self.server_close()
        _remove(self._path, self._own)

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing: a reader has gone."""
        del request, client_address


def run(channel: socket.socket, file: Path | None, place: Path | None, version: str) -> None:
    """Take snapshots until the other end closes; then remove file and socket."""
    problems = Problems()
    server: MetricsSocket | None = None
    target = None if file is None else MetricsFile(file)
    try:
        while data := channel.recv(MOST_BYTES):
            snapshots: list[dict[str, Any]] = json.loads(data)
            text, problem = text_of(snapshots, version), None
            if place is not None and server is None:
                server, problem = _opened(place)
            if server is not None:
                server.text = text
            if target is not None:
                problem = target.write(text) or problem
            problems.tell(problem)
    finally:
        if server is not None:
            server.close()
        if target is not None:
            target.remove()


def _opened(place: Path) -> tuple[MetricsSocket | None, str | None]:
    try:
        server = MetricsSocket(place)
    except OSError as error:
        return None, f"{place}: cannot be used: {error.strerror or error}; tried again each time"
    threading.Thread(target=server.serve_forever, name="socket", daemon=True).start()
    return server, None


def main() -> None:
    """Run on the descriptor that the daemon handed over."""
    descriptor, file, place, version = sys.argv[1:]
    if os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # it yields to the cycle
    channel = socket.socket(fileno=int(descriptor))
    run(channel, Path(file) if file else None, Path(place) if place else None, version)


if __name__ == "__main__":
    main()
