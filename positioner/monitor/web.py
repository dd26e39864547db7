"""The live view as one page for browsers of this machine: Python's own server, one thread for each browser. Shell.

A browser that reads slowly holds up its own thread alone: each message is the newest state, and none waits for it.
"""

from __future__ import annotations

import json
import math
import os
import secrets
import signal
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import TYPE_CHECKING, Any, ClassVar
from urllib.parse import parse_qs, urlsplit

from positioner.errors import UsageError
from positioner.monitor.page_data import Stream, setup_of
from positioner.monitor.source import NICENESS

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

    from positioner.monitor.source import Source

PORT = 8642
HOST = "127.0.0.1"
EVERY_S = 0.1
MOST_STREAMS = 16
_PATIENCE_S = 10.0
"""A browser that takes nothing for so long is left; it comes again by itself."""
_LONGEST_ORDER, _MOST_DIGITS = 1024, 4
_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class PageServer(ThreadingHTTPServer):
    """The page of a source, at `address`."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, source: Source, port: int, valve: str | None = None) -> None:
        """Take the port; 0 for any that is free. The page begins with `valve`, or with the first one.

        Raises:
            UsageError: it cannot be had.
        """
        try:
            super().__init__((HOST, port), _Handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or "it is none: a port is from 1 to 65535"
            raise UsageError(f"--port {port}: {reason}; give another one") from error
        self.source, self.valve = source, valve or source.valves[0]
        self.streams = threading.BoundedSemaphore(MOST_STREAMS)
        self.stopping = threading.Event()
        own = self.server_address[1]
        self.address = f"http://{HOST}:{own}/"
        self.hosts = frozenset({f"{HOST}:{own}", f"localhost:{own}"})
        """What a browser may call this server: another name would be one that leads here by a trick of the DNS."""

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing: a browser has gone."""
        del request, client_address

    def close(self) -> None:
        """End, and let the port go."""
        self.stopping.set()
        self.shutdown()
        self.server_close()


class _Handler(BaseHTTPRequestHandler):
    """One request of one browser."""

    server: PageServer
    timeout: ClassVar[float] = _PATIENCE_S
    server_version, sys_version = "positioner", ""

    def do_GET(self) -> None:
        """Answer with the page, or with its stream of states."""
        if self._is_refused():
            return
        try:
            asked = urlsplit(self.path)
        except ValueError:  # such as half an IPv6 address
            self.send_error(HTTPStatus.BAD_REQUEST)
            return
        if asked.path == "/":
            self._page()
        elif asked.path == "/events":
            self._events(parse_qs(asked.query).get("valve", [self.server.valve])[0])
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:
        """Obey an order to the player of a log; no order concerns a valve."""
        if self._is_refused():
            return
        own = self.headers.get("Origin") in {f"http://{host}" for host in self.server.hosts}
        is_json = self.headers.get_content_type() == "application/json"
        length = self.headers.get("Content-Length", "")
        is_short = length.isdecimal() and len(length) <= _MOST_DIGITS and int(length) <= _LONGEST_ORDER
        if not (own and is_json and is_short and self.path == "/play"):
            self.send_error(HTTPStatus.FORBIDDEN)
            return
        try:
            order = json.loads(self.rfile.read(int(length)))
            obey, value = _ORDERS[order["do"]], float(order.get("value", 0.0))
            obey(self.server.source, value if math.isfinite(value) else 0.0)
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
            self.send_error(HTTPStatus.BAD_REQUEST)
        else:
            self.send_response(HTTPStatus.NO_CONTENT)
            self.end_headers()

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - as the base class names it
        """Say nothing."""

    def _is_refused(self) -> bool:
        if self.headers.get("Host") in self.server.hosts:
            return False
        self.send_error(HTTPStatus.MISDIRECTED_REQUEST)
        return True

    def _page(self) -> None:
        nonce = secrets.token_urlsafe(16)
        text = resources.files("positioner.monitor").joinpath("page.html").read_text(encoding="utf-8")
        setup = json.dumps(setup_of(self.server.source, self.server.valve)).replace("<", "\\u003c")
        body = text.replace("@NONCE@", nonce).replace("@SETUP@", setup).encode()
        own = f"'nonce-{nonce}'"
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.send_header(
            "Content-Security-Policy",
            f"default-src 'none'; connect-src 'self'; script-src {own}; style-src {own}; img-src data:; "
            "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
        )
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def _events(self, valve: str) -> None:
        """Send the newest state again and again, as server-sent events (WHATWG HTML, 9.2)."""
        server = self.server
        if valve not in server.source.valves:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        if not server.streams.acquire(blocking=False):
            self.send_error(HTTPStatus.SERVICE_UNAVAILABLE)
            return
        try:
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/event-stream")
            for name, value in _HEADERS.items():
                self.send_header(name, value)
            self.end_headers()
            stream = Stream(server.source, valve)
            while not server.stopping.is_set():
                self.wfile.write(b"data: " + json.dumps(stream.next()).encode() + b"\n\n")
                self.wfile.flush()
                server.stopping.wait(EVERY_S)
        except OSError:
            pass  # the browser has gone, or takes nothing
        finally:
            server.streams.release()


_ORDERS: dict[str, Callable[[Any, float], None]] = {
    "toggle": lambda source, _: source.toggle(),
    "seek": lambda source, value: source.seek(value),
    "speed": lambda source, value: source.play_at(value),
}


def serve(source: Source, port: int, valve: str | None, report: Callable[[str], object]) -> None:
    """Serve the page until SIGINT or SIGTERM; `report` gets its address.

    Raises:
        UsageError: the port cannot be had.
        Exception: the one that has ended the source's thread.
    """
    server = PageServer(source, port, valve)
    os.nice(NICENESS)
    stopping = server.stopping

    def stop(number: int, frame: FrameType | None) -> None:
        del number, frame
        stopping.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    threading.Thread(target=server.serve_forever, name="page", daemon=True).start()
    report(server.address)
    while not stopping.is_set() and source.failure is None:
        stopping.wait(EVERY_S)
    server.close()
    if source.failure is not None:
        raise source.failure
