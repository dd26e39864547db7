"""The metrics writer: the process that keeps a daemon's newest metrics, writes their file and answers at their socket.

The daemon hands snapshots over and never waits. When its end of the channel closes, however the daemon ended, file and
socket go: nobody shall take old metrics for new ones. Shell.
"""

from __future__ import annotations

import json
import os
import socket
import stat
import sys
import threading
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from socketserver import ThreadingUnixStreamServer
from typing import Any, ClassVar

from positioner.metrics.exposition import CONTENT_TYPE, text_of
from positioner.metrics.snapshot import MOST_BYTES

_FILE_MODE, _SOCKET_MODE = 0o644, 0o666
"""Metrics are no secret, and their readers are other users; who may reach them the folder says."""
_PATIENCE_S = 10.0


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
            sys.stderr.write(f"{line}\n")
            sys.stderr.flush()


def write_file(path: Path, text: str) -> str | None:
    """Put the text in place of the file, all at once; return why that failed, or None."""
    new = path.with_name(f"{path.name}.new")
    try:
        descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, _FILE_MODE)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            os.fchmod(descriptor, _FILE_MODE)
            file.write(text)
        new.replace(path)
    except OSError as error:
        with suppress(OSError):
            new.unlink()
        return f"{path}: cannot be written: {error.strerror}; tried again each time"
    return None


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

    def __init__(self, path: Path) -> None:
        """Make the socket; one that is left over from before goes.

        Raises:
            OSError: it cannot be made, or something else has its name.
        """
        with suppress(FileNotFoundError):
            if not stat.S_ISSOCK(path.lstat().st_mode):
                raise FileExistsError(17, "something else has this name", str(path))
            path.unlink()
        super().__init__(str(path), _Handler)
        path.chmod(_SOCKET_MODE)
        self.text = "# EOF\n"

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing: a reader has gone."""
        del request, client_address


def run(channel: socket.socket, file: Path | None, place: Path | None, version: str) -> None:
    """Take snapshots until the other end closes; then remove file and socket."""
    problems = Problems()
    server: MetricsSocket | None = None
    try:
        while data := channel.recv(MOST_BYTES):
            snapshots: list[dict[str, Any]] = json.loads(data)
            text, problem = text_of(snapshots, version), None
            if place is not None and server is None:
                server, problem = _opened(place)
            if server is not None:
                server.text = text
            if file is not None:
                problem = write_file(file, text) or problem
            problems.tell(problem)
    finally:
        if server is not None:
            server.shutdown()
            server.server_close()
        for path in (file, place if server is not None else None):
            if path is not None:
                with suppress(OSError):
                    path.unlink()


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
