"""What makes a command late although the processor is fast enough: memory, timers, clock rates, limits. Shell.

Each is looked at for a valve whose period is short; docs/real-time.md is the recipe.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.doctor.finding import Finding, Level
from positioner.doctor.scheduling import is_real_time

if TYPE_CHECKING:
    from collections.abc import Iterator

_PROCESSES, _PROCESSORS, _KERNEL = Path("/proc"), Path("/sys/devices/system/cpu"), Path("/proc/sys/kernel")
_COARSE_SLACK_NS = 1000
_LEAST_SHARE = 0.5
"""Of each second, for all real-time processes of a processor: a positioner at 1 kHz needs about a third."""


def of_machine() -> Iterator[Finding]:
    """Yield the findings on the clock rate of the processors and on the limit of real-time processes."""
    governors = {path.read_text(encoding="ascii").strip() for path in _PROCESSORS.glob("cpu*/cpufreq/scaling_governor")}
    if slow := sorted(governors - {"performance"}):
        text = f"the governor '{slow[0]}' lets processors run slowly: the first cycles after a rest are late"
        fix = "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor"
        yield Finding(Level.WARN, "governor", text, fix)
    else:
        yield Finding(
            Level.OK, "governor", "performance" if governors else "none: the clock rate is not ours to choose"
        )
    runtime_us, period_us = (_number(_KERNEL / f"sched_rt_{name}_us") for name in ("runtime", "period"))
    if runtime_us is None or not period_us:
        return
    share = runtime_us / period_us
    if 0.0 <= share < _LEAST_SHARE:
        text = f"real-time processes may use only {share:.0%} of each second; then they stand still"
        yield Finding(Level.WARN, "throttling", text, "sudo sysctl kernel.sched_rt_runtime_us=950000")
    else:
        limit = "the whole" if share < 0.0 else f"{share:.0%}"
        yield Finding(Level.OK, "throttling", f"real-time processes may use {limit} of each second")


def of_daemon(pid: int | None, unit: str | None) -> Iterator[Finding]:
    """Yield the findings on memory, timers and processors of the daemon with the process `pid`."""
    if pid is None:
        return
    if (locked_kb := _locked_kb(pid)) is not None:
        if locked_kb:
            yield Finding(Level.OK, "memory", f"{locked_kb / 1024:.0f} MiB are locked in RAM")
        else:
            text = "not locked: a page that must be read from the disk makes a command late"
            fix = f"sudo systemctl edit {unit}  # LimitMEMLOCK=infinity" if unit else "ulimit -l unlimited"
            yield Finding(
                Level.WARN, "memory", text, f"{fix}, and start it again" if unit else f"{fix}  # before its start"
            )
    slack_ns = _number(_PROCESSES / str(pid) / "timerslack_ns")
    if slack_ns is not None and slack_ns > _COARSE_SLACK_NS and not is_real_time(pid):
        text = f"the kernel may wake it {slack_ns / 1e3:g} µs late"
        lasting = f"  # for good: sudo systemctl edit {unit}, TimerSlackNSec=1us" if unit else ""
        yield Finding(Level.WARN, "timer slack", text, f"echo 1 | sudo tee /proc/{pid}/timerslack_ns{lasting}")
    isolated = _listed(_PROCESSORS / "isolated")
    if isolated and not _affinity(pid) <= isolated:
        first = min(isolated)
        text = f"processor {first} is kept free of other processes, and the daemon does not run there alone"
        lasting = f"  # for good: sudo systemctl edit {unit}, CPUAffinity={first}" if unit else ""
        yield Finding(Level.WARN, "affinity", text, f"sudo taskset --cpu-list --pid {first} {pid}{lasting}")


def _locked_kb(pid: int) -> int | None:
    try:
        lines = (_PROCESSES / str(pid) / "status").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) for line in lines if line.startswith("VmLck:")), None)


def _affinity(pid: int) -> set[int]:
    try:
        return os.sched_getaffinity(pid)
    except ProcessLookupError:
        return set()


def _number(path: Path) -> int | None:
    try:
        return int(path.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def _listed(path: Path) -> set[int]:
    """Return the processors in a list of the kernel, such as `1-3,5`."""
    try:
        parts = path.read_text(encoding="ascii").strip().split(",")
    except OSError:
        return set()
    ranges = [part.partition("-") for part in parts if part]
    return {number for low, _, high in ranges for number in range(int(low), int(high or low) + 1)}
