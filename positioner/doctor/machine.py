"""Findings on the machine: its clock, SQLite, and the tool that lists network interfaces. Shell."""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
import time

from positioner.doctor import link
from positioner.doctor.finding import Finding, Level
from positioner.machine.build import is_compiled

_COARSE_TIMER_S = 1e-4
_OLDEST_SQLITE = (3, 12, 0)
"""The first version with `PRAGMA synchronous = EXTRA`, which protects the stiction table in a power cut."""
_IP = ("ip", "-details", "-statistics", "-json", "link", "show")
_IP_WAIT_S = 5.0
INSTALL_COMPILED = (
    "sudo apt install gcc python3-dev  # then install the positioner again, not as editable: it is compiled"
)


def timer() -> Finding:
    """Return the finding on the resolution of the monotonic clock."""
    resolution_s = time.clock_getres(time.CLOCK_MONOTONIC)
    if resolution_s > _COARSE_TIMER_S:
        text = f"the monotonic clock has steps of {resolution_s * 1e3:g} ms: too coarse for a control loop"
        return Finding(
            Level.FAIL,
            "timer",
            text,
            "grep -E HIGH_RES_TIMERS /boot/config-$(uname -r); cat /proc/cmdline  # =y is needed, and no highres=off",
        )
    return Finding(Level.OK, "timer", f"the monotonic clock has steps of {resolution_s * 1e9:g} ns")


def sqlite() -> Finding:
    """Return the finding on the version of SQLite; its WAL bug before 3.51.3 does not matter: no WAL is used."""
    if sqlite3.sqlite_version_info < _OLDEST_SQLITE:
        wanted = ".".join(map(str, _OLDEST_SQLITE))
        text = f"{sqlite3.sqlite_version} is older than {wanted}: the stiction table could be lost in a power cut"
        return Finding(Level.FAIL, "SQLite", text, "sudo apt install --only-upgrade libsqlite3-0")
    return Finding(Level.OK, "SQLite", f"{sqlite3.sqlite_version}, with the rollback journal")


def build() -> Finding:
    """Return the finding on the build that runs: compiled or interpreted."""
    if is_compiled():
        return Finding(Level.OK, "build", "compiled")
    text = "interpreted, which takes several times as long for a cycle"
    return Finding(Level.OK, "build", text, INSTALL_COMPILED)


def links() -> tuple[tuple[link.Link, ...] | None, tuple[Finding, ...]]:
    """Return all network interfaces, and the findings on `ip`; None where it gives no usable answer."""
    program = shutil.which("ip", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")
    if program is None:
        text = "the command `ip` is not installed: nothing is known about the interface"
        return None, (Finding(Level.WARN, "interface", text, "sudo apt install iproute2"),)
    try:
        done = subprocess.run(  # noqa: S603 - a system tool with arguments of our own
            [program, *_IP[1:]], capture_output=True, text=True, check=True, timeout=_IP_WAIT_S
        )
        return link.parse_links(done.stdout), ()
    except (OSError, subprocess.SubprocessError, link.UnreadableAnswerError) as error:
        text = f"`{' '.join(_IP)}` gives no usable answer: {error}"
        return None, (Finding(Level.WARN, "interface", text, "sudo apt install --only-upgrade iproute2"),)
