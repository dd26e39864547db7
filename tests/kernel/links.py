"""Network links, programs and waiting: what every kernel test needs."""

from __future__ import annotations

import contextlib
import itertools
import subprocess
import time
from typing import TYPE_CHECKING, Self

from harness.plan import time_factor

from positioner.bus.address import BusAddress

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path
    from types import TracebackType

TIMEOUT_S = 60.0 * time_factor()
"""The longest time that a test waits in a kernel that shares a busy machine."""
_NUMBERS = itertools.count(10)


def command(*words: str, check: bool = True, text: str | None = None) -> str:
    """Return the output of a command; where it fails, its output is in the message of the failed test."""
    done = subprocess.run(words, check=False, capture_output=True, text=True, input=text, timeout=TIMEOUT_S * 10)
    assert not check or done.returncode == 0, f"{' '.join(words)}: {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout + done.stderr


def add_vcan(name: str) -> None:
    command("ip", "link", "add", "dev", name, "type", "vcan")
    command("ip", "link", "set", name, "up")


@contextlib.contextmanager
def vcan(name: str = "") -> Iterator[BusAddress]:
    """Make a virtual CAN interface that is up, for the time of a test."""
    name = name or f"vcan{next(_NUMBERS)}"
    add_vcan(name)
    try:
        yield BusAddress(channel=name)
    finally:
        command("ip", "link", "delete", name, check=False)


def until(holds: Callable[[], object], what: object = "it", timeout_s: float = TIMEOUT_S) -> None:
    """Wait until `holds`, or fail with the message `what`, or with its result where it is a function."""
    deadline_s = time.monotonic() + timeout_s
    while not holds():
        assert time.monotonic() < deadline_s, what() if callable(what) else what
        time.sleep(0.02)


class Program:
    """A program beside the test; its output goes to a file."""

    def __init__(self, words: Sequence[str], output: Path) -> None:
        self.output = output
        with output.open("wb") as file:
            self.process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=file, stderr=file)

    @property
    def text(self) -> str:
        return self.output.read_text(encoding="utf-8", errors="replace")

    def wait(self) -> int:
        return self.process.wait(TIMEOUT_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.process.poll() is None:
            self.process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(5.0)
        self.process.kill()
        self.process.wait()
