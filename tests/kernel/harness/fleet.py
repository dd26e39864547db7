"""Kernels at work: as many at once as the machine has processors, each with the tests of one file."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from harness import boot, emulated, user_mode
from harness.plan import BEGAN, CACHE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from harness.plan import Kind

_POLL_S = 0.2
_LAST_LINES = 30


@dataclass(frozen=True, slots=True)
class Group:
    """Tests for one kernel: those of one file and kind."""

    kind_name: str
    kind: Kind
    name: str
    tests: Sequence[str]


class Guest:
    """One kernel that runs a group of tests and ends."""

    def __init__(self, group: Group) -> None:
        """Boot it."""
        self.group = group
        self.out: Path = CACHE / "runs" / group.name
        shutil.rmtree(self.out, ignore_errors=True)
        self.out.mkdir(parents=True)
        make = emulated.command if group.kind.emulated else user_mode.command
        command = make(group.kind_name, group.kind, self.out, group.tests)
        self._read = 0
        self._overdue = ""
        self._started_s = time.monotonic()
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
        age_s, kind = time.monotonic() - self._started_s, self.group.kind
        if age_s > kind.timeout_s:
            self._overdue = f"its tests were not over after {kind.timeout_s:g} s"
        elif age_s > kind.boot_s and not self.kernel:
            self._overdue = f"it had not come as far as its tests after {kind.boot_s:g} s"
        if self._overdue:
            self.end()
        return self._process.poll() is not None

    @property
    def is_overdue(self) -> bool:
        """Whether it was ended because its tests took too long."""
        return bool(self._overdue)

    @property
    def kernel(self) -> str:
        """The name and version of the kernel, empty before it has come as far as its tests."""
        began = self._text(BEGAN).strip()
        return f"{self.engine} {began}" if began else ""

    @property
    def engine(self) -> str:
        """The name of the emulator or the architecture that the kernel runs on."""
        return "QEMU" if self.group.kind.emulated else "user-mode Linux"

    def why_it_never_began(self) -> str:
        """Return in one line why it ended before its first test, empty where it came further."""
        console = self._text("console.log")
        if self._read or (self.kernel and not boot.panicked(console)):
            return ""
        return self._overdue or boot.why_it_ended(console)

    def end(self) -> None:
        """End it now, with everything that it started."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, 9)
            self._process.wait()

    def last_words(self) -> str:
        """Return the last lines of its tests and of its console."""
        words = [self._overdue]
        for name in ("pytest.log", "console.log"):
            lines = self._text(name).splitlines()[-_LAST_LINES:]
            words += [f"--- end of {self.out / name}", *lines]
        return "\n".join(words)

    def _text(self, name: str) -> str:
        path = self.out / name
        return path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""


def why_user_mode_cannot_run(kind: Kind) -> str:
    """Return in one line why user-mode Linux does not come as far as a test on this machine, empty where it does."""
    for _ in range(2):
        guest = Guest(Group("vcan", kind, "probe", ()))
        try:
            while not guest.has_ended():
                time.sleep(_POLL_S)
        finally:
            guest.end()
        why = guest.why_it_never_began()
        if not why:
            break
    return why


def run(groups: Sequence[Group], at_once: int) -> Iterator[tuple[Guest, dict[str, Any] | None]]:
    """Run the groups; yield each report with its kernel, and None once a kernel is over."""
    waiting, running = list(groups), list[Guest]()
    try:
        while waiting or running:
            while waiting and len(running) < at_once:
                running.append(Guest(waiting.pop(0)))
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
