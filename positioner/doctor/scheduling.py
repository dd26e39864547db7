"""Which scheduling policy is really in force, of this command and of the valve's running daemon. Shell."""

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
"""With this sample period or a longer one, time-sharing is no reason to worry."""


def of_this_command() -> Finding:
    """Return the policy under which this command, and what is started as it is, runs."""
    return Finding(Level.OK, "scheduling", f"this command: {_told(0)}")


def of_daemon(pid: int | None, sample_period_s: float, unit: str | None) -> Finding:
    """Return the policy of the daemon with the process `pid`; `unit` is its systemd unit, None without one."""
    if pid is None:
        start = f"sudo systemctl start {unit}" if unit else ""
        return Finding(Level.OK, "daemon", "none runs for this valve", start)
    try:
        policy, told = os.sched_getscheduler(pid) & ~os.SCHED_RESET_ON_FORK, _told(pid)
    except ProcessLookupError:
        return Finding(Level.WARN, "daemon", f"process {pid} has just ended", "positioner doctor again")
    text = f"process {pid}: {told}"
    if policy in _REAL_TIME:
        return Finding(Level.OK, "daemon", text)
    if sample_period_s >= SLOW_ENOUGH_S:
        return Finding(Level.OK, "daemon", f"{text}, fit for a period of {sample_period_s * 1e3:g} ms")
    text += f": a busy machine delays it beyond its period of {sample_period_s * 1e3:g} ms"
    return Finding(Level.WARN, "daemon", text, f"sudo chrt --fifo --pid 50 {pid}{_lasting(unit)}")


def _lasting(unit: str | None) -> str:
    return f"; to last: sudo systemctl edit {unit}, with the lines of realtime.conf" if unit else ""


def _told(pid: int) -> str:
    """Return policy, priority and processors in words.

    Raises:
        ProcessLookupError: the process has ended.
    """
    policy = os.sched_getscheduler(pid) & ~os.SCHED_RESET_ON_FORK
    name = _NAMES.get(policy, f"policy {policy}")
    if policy in _REAL_TIME:
        name += f" priority {os.sched_getparam(pid).sched_priority}"
    processors = ", ".join(str(number) for number in sorted(os.sched_getaffinity(pid)))
    return f"{name} on processor {processors}"
