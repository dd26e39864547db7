"""Kernels at work: as many at once as the machine has processors, each with the tests of one file."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from typing import TYPE_CHECKING, Any

from harness import emulated, user_mode
from harness.plan import CACHE, KINDS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

_POLL_S = 0.2
_LAST_LINES = 30


class Guest:
    """One kernel that runs the tests of one file and ends."""

    def __init__(self, kind_name: str, name: str, tests: Sequence[str]) -> None:
        """Boot it."""
        self.kind_name = kind_name
        self.tests = list(tests)
        self.out: Path = CACHE / "runs" / name
        shutil.rmtree(self.out, ignore_errors=True)
        self.out.mkdir(parents=True)
        kind = KINDS[kind_name]
        make = emulated.command if kind.emulated else user_mode.command
        command = make(kind_name, kind, self.out, tests)
        self._read = 0
        self._deadline_s = time.monotonic() + kind.patience_s
        with (self.out / "console.log").open("wb") as console:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=console,
                start_new_session=True,
            )

    def reports(self) -> Iterator[dict[str, Any]]:
        """Yield the reports that have come since the last call."""
        path = self.out / "results.jsonl"
        if not path.exists():
            return
        with path.open("rb") as lines:
            lines.seek(self._read)
            for line in lines:
                if not line.endswith(b"\n"):
                    return
                self._read += len(line)
                yield json.loads(line)

    def has_ended(self) -> bool:
        """Return whether it is over; a kernel that takes too long is ended."""
        if self._process.poll() is not None:
            return True
        if time.monotonic() > self._deadline_s:
            self.end()
        return self._process.poll() is not None

    def end(self) -> None:
        """End it now, with everything that it started."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, 9)
            self._process.wait()

    def last_words(self) -> str:
        """Return the end of what its tests and its console said."""
        said = []
        for name in ("pytest.log", "console.log"):
            path = self.out / name
            if path.exists():
                lines = path.read_text(encoding="utf-8", errors="replace").splitlines()[-_LAST_LINES:]
                said += [f"--- end of {path}", *lines]
        return "\n".join(said)


def run(
    groups: Sequence[tuple[str, str, Sequence[str]]], at_once: int
) -> Iterator[tuple[Guest, dict[str, Any] | None]]:
    """Run (kind, name, tests) groups; yield each report with its kernel, and None once a kernel is over."""
    waiting, running = list(groups), list[Guest]()
    try:
        while waiting or running:
            while waiting and len(running) < at_once:
                running.append(Guest(*waiting.pop(0)))
            for guest in list(running):
                over = guest.has_ended()
                for report in guest.reports():
                    yield guest, report
                if over:
                    running.remove(guest)
                    yield guest, None
            time.sleep(_POLL_S)
    finally:
        for guest in running:
            guest.end()
