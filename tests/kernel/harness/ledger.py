"""The summary at the end of the kernel tests: which kernel ran what, what did not run, and what needed more tries."""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import TYPE_CHECKING

from harness.plan import KINDS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from harness.fleet import Guest


class Ledger:
    """The summary of one session."""

    def __init__(self) -> None:
        """Begin with nothing counted."""
        self.ran: Counter[tuple[str, str]] = Counter()
        """The number of reported tests, by (kernel, kind)."""
        self.more_tries: list[str] = []
        self._not_begun: list[str] = []
        self._why_short = ""
        self._left_out: Sequence[str] = ()

    def takes_short_form(self, why: str, left_out: Sequence[str]) -> None:
        """Note that user-mode Linux is replaced by QEMU, why, and which tests are not in the short form for it."""
        self._why_short = why
        self._left_out = left_out

    def never_began(self, guest: Guest, why: str, *, last: bool) -> None:
        """Note that a kernel ended before its first test, and in one line why."""
        line = f"the kernel for {guest.group.name} ({guest.engine}) ended before its first test: {why}"
        (self._not_begun if last else self.more_tries).append(line)

    def why_incomplete(self) -> str:
        """Return the kernels and tests that did not run although they should have, a line each; empty for none."""
        if self._not_begun or self.ran or not self._left_out:
            return "\n".join(self._not_begun)
        return f"no test ran: none of these is in the short form for QEMU ({self._why_short})"

    def sections(self) -> list[tuple[str, list[str]]]:
        """Return title and lines of each section that is shown at the end."""
        by_kernel: dict[str, list[str]] = defaultdict(list)
        for (kernel, kind), count in sorted(self.ran.items(), key=lambda entry: list(KINDS).index(entry[0][1])):
            by_kernel[kernel or "a kernel that never gave its version"].append(f"{count} {kind}")
        lines = [f"{kernel}: {', '.join(counts)}" for kernel, counts in by_kernel.items()]
        if self._why_short:
            lines.append(f"short form in QEMU (left out: {len(self._left_out)}) since {self._why_short}")
            lines += [f"left out: {nodeid}" for nodeid in self._left_out]
        shown = [("kernels", [*lines, *self._not_begun])]
        if self.more_tries:
            shown.append(("failed at first, and were run again alone", self.more_tries))
        return shown
