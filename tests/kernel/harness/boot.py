"""Why a kernel ended before its first test, in one line: read from its console output."""

from __future__ import annotations

import re

_PANIC = re.compile(r"Kernel panic - not syncing: .*")
_PREFIX = re.compile(r"^(?:<\d>|\[ *\d+\.\d+\] )+")
_CAUSES = (
    (r"ptrace set fp regs failed", "the processor has registers that this user-mode Linux does not know (AMX)"),
    (r"check_ptrace|check_sysemu|^ptrace: ", "this machine forbids one process to trace another"),
    (
        r"ran out of space|cannot allocate memory|setup_physmem - mapping .* failed|out of memory",
        "this machine has too little memory left for the kernel",
    ),
)
"""Patterns of a console's last lines, and their meaning."""


def panicked(console: str) -> bool:
    """Return whether the kernel with this console output panicked."""
    return _PANIC.search(console) is not None


def why_it_ended(console: str) -> str:
    """Return in one line why the kernel with this console output ended."""
    lines = [stripped for line in console.splitlines() if (stripped := _PREFIX.sub("", line.strip()))]
    for pattern, meaning in _CAUSES:
        found = next((line for line in lines if re.search(pattern, line, re.IGNORECASE)), None)
        if found is not None:
            return f"{meaning}: {found!r}"
    panic = next((match[0] for line in lines if (match := _PANIC.search(line))), None)
    if panic is not None:
        return panic
    return f"it ended with {lines[-1]!r}" if lines else "it said nothing"
