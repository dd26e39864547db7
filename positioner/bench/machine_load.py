"""Who uses this machine's processors, second by second: the bench's own processes, or others. Shell."""

from __future__ import annotations

import os
import platform
import time
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.bench.timing import Second

if TYPE_CHECKING:
    from collections.abc import Iterable

_NS = 1_000_000_000
_IDLE, _WAITING, _STOLEN = 4, 5, 8
"""Columns of /proc/stat: a processor has nothing to do, waits for a disk, or is given to others by its host."""


class MachineLoad:
    """Watches the processors from its start on; `look` must be called more often than once a second."""

    def __init__(self, start_ns: int, pids: Iterable[int]) -> None:
        """Begin; this process, the processes `pids` and their children are the bench."""
        self._start_ns = self._begin_ns = start_ns
        self._pids = [os.getpid(), *pids]
        self._pids += [child for pid in self._pids[1:] for child in _children(pid)]
        (self._idle_s, self._stolen_s), self._own_s = _idle_and_stolen_s(), self._used_s()
        self.seconds: list[Second] = []

    def look(self, now_ns: int) -> None:
        """End the present second if it is over."""
        if now_ns - self._begin_ns < _NS:
            return
        lasted_s = (now_ns - self._begin_ns) / _NS
        (idle_s, stolen_s), own_s = _idle_and_stolen_s(), self._used_s()
        busy_s = (os.cpu_count() or 1) * lasted_s - (idle_s - self._idle_s)
        foreign = max(busy_s - (own_s - self._own_s), 0.0) / lasted_s
        self.seconds.append(Second((self._begin_ns - self._start_ns) / _NS, foreign, stolen_s - self._stolen_s))
        self._begin_ns, self._idle_s, self._stolen_s, self._own_s = now_ns, idle_s, stolen_s, own_s

    def _used_s(self) -> float:
        """Return the processor time in s that the bench has used."""
        return sum(_used_by(pid) for pid in self._pids)


def _used_by(pid: int) -> float:
    try:
        return time.clock_gettime(~pid << 3 | 2)  # clock_getcpuclockid(3); /proc/PID/stat counts in steps of 10 ms
    except OSError:  # it has ended
        return 0.0


def _idle_and_stolen_s() -> tuple[float, float]:
    """Return the times in s for which the processors had nothing to do, and were given to others by their host.

    Both are 0 where the system does not say.
    """
    try:
        columns = Path("/proc/stat").read_text(encoding="ascii").split("\n", maxsplit=1)[0].split()
    except OSError:
        return 0.0, 0.0
    ticks_per_s = os.sysconf("SC_CLK_TCK")
    return (int(columns[_IDLE]) + int(columns[_WAITING])) / ticks_per_s, int(columns[_STOLEN]) / ticks_per_s


def _children(pid: int) -> list[int]:
    try:
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()]
    except OSError:
        return []


def machine() -> str:
    """Return the processor, the number of cores and the kernel."""
    name = platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    name = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), name)
    return f"{name}, {os.cpu_count()} cores, {platform.system()} {platform.release()}"
