"""The processes of a bench: started, ready, and ended. Shell."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Self

from positioner.errors import BenchError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import TracebackType

_START_S = 120.0
_STOP_S = 10.0
_SOURCES = str(Path(__file__).resolve().parents[2])


def prioritize(pid: int, priority: int) -> bool:
    """Give a process a real-time priority (FIFO), but not its children; return whether the system allows it.

    Priority 0 takes it away again. The process 0 is this one.
    """
    policy = os.SCHED_FIFO if priority else os.SCHED_OTHER
    try:
        os.sched_setscheduler(pid, policy | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError:
        return False
    return True


class BenchProcess:
    """One of our programs as a process that reports over sd_notify(3); its output goes to a log file."""

    def __init__(self, module: str, arguments: Sequence[str], log: Path) -> None:
        """Start `python -m module arguments`."""
        self.name = module.split(".", maxsplit=1)[0].replace("_", "-")
        self.log = log
        self._folder = tempfile.TemporaryDirectory(prefix="positioner-")
        address = str(Path(self._folder.name) / "notify")
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(address)
        path = os.pathsep.join(filter(None, (_SOURCES, os.environ.get("PYTHONPATH"))))
        environment = {**os.environ, "NOTIFY_SOCKET": address, "PYTHONPATH": path}
        with log.open("ab") as output:
            self.process = subprocess.Popen(  # noqa: S603 - our own modules, with arguments we made
                [sys.executable, "-m", module, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                env=environment,
            )

    def wait_for(self, field: str) -> None:
        """Wait until a notification contains `field`.

        Raises:
            BenchError: the process ended first, or the notification did not come in time.
        """
        deadline_s = time.monotonic() + _START_S
        while time.monotonic() < deadline_s:
            self.check()
            if select.select([self._socket], [], [], 0.05)[0] and field in self._socket.recv(4096).decode():
                return
        raise BenchError(f"{self.name} was not ready within {_START_S:g} s; its log is {self.log}")

    def check(self) -> None:
        """Check that the process runs.

        Raises:
            BenchError: it has ended; the message has the last line of its log.
        """
        code = self.process.poll()
        if code is not None:
            raise BenchError(f"{self.name} ended with status {code}: {self._last_line()} (log: {self.log})")

    def drain(self) -> None:
        """Discard the notifications, so that the socket never fills."""
        while select.select([self._socket], [], [], 0.0)[0]:
            self._socket.recv(4096)

    def stop(self) -> int:
        """End the process, by force if SIGTERM does not end it, and return its exit status."""
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(_STOP_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
        code = self.process.wait()
        self._socket.close()
        self._folder.cleanup()
        return code

    def __enter__(self) -> Self:
        """Return the running child."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End it."""
        self.stop()

    def _last_line(self) -> str:
        lines: list[str] = []
        with contextlib.suppress(OSError):
            lines = [line for line in self.log.read_text(encoding="utf-8", errors="replace").splitlines() if line]
        return lines[-1] if lines else "its log is empty"
