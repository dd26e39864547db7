"""The scheduling policy of this command, and of the valve's running daemon. Shell."""

from __future__ import annotations

import os

from positioner.doctor.finding import Finding, Level

_NAMES = {
    os.SCHED_OTHER: "SCHED_OTHER",
    os.SCHED_BATCH: "SCHED_BATCH",
    os.SCHED_IDLE: "SCHED_IDLE",
    os.SCHED_FIFO: "SCHED_FIFO",
    os.SCHED_RR: "SCHED_RR",
}
_REAL_TIME = {os.SCHED_FIFO, os.SCHED_RR}
SLOW_ENOUGH_S = 0.01
"""From this sample period on, time-sharing is good enough."""


def of_this_command() -> Finding:
    """Return the policy of this command; a daemon that is started in the same way has the same policy."""
    return Finding(Level.OK, "scheduling", f"this command: {_described(0)}")


def of_daemon(pid: int | None, sample_period_s: float, unit: str | None) -> Finding:
    """Return the policy of the daemon with the process `pid`; `unit` is its systemd unit, None without one."""
    if pid is None:
        start = f"sudo systemctl start {unit}" if unit else ""
        return Finding(Level.OK, "daemon", "none runs for this valve", start)
    try:
        policy, description = os.sched_getscheduler(pid) & ~os.SCHED_RESET_ON_FORK, _described(pid)
    except ProcessLookupError:
        return Finding(Level.WARN, "daemon", f"process {pid} has just ended", "positioner doctor  # once more")
    text = f"process {pid}: {description}"
    if policy in _REAL_TIME:
        return Finding(Level.OK, "daemon", text)
    if sample_period_s >= SLOW_ENOUGH_S:
        return Finding(Level.OK, "daemon", f"{text}, fit for a period of {sample_period_s * 1e3:g} ms")
    text += f": a busy machine delays it beyond its period of {sample_period_s * 1e3:g} ms"
    lasting = f"  # until its next start; for good: sudo systemctl edit {unit}, with the lines of realtime.conf"
    return Finding(Level.WARN, "daemon", text, f"sudo chrt --fifo --pid 50 {pid}{lasting if unit else ''}")


def is_real_time(pid: int) -> bool:
    """Return whether a process has a real-time policy; also where it has ended."""
    try:
        return os.sched_getscheduler(pid) & ~os.SCHED_RESET_ON_FORK in _REAL_TIME
    except ProcessLookupError:
        return True


def _described(pid: int) -> str:
    """Return policy, priority and processors of a process.

    Raises:
        ProcessLookupError: the process has ended.
    """
    policy = os.sched_getscheduler(pid) & ~os.SCHED_RESET_ON_FORK
    name = _NAMES.get(policy, f"policy {policy}")
    if policy in _REAL_TIME:
        name += f" priority {os.sched_getparam(pid).sched_priority}"
    processors = ", ".join(str(number) for number in sorted(os.sched_getaffinity(pid)))
    return f"{name} on processor {processors}"
