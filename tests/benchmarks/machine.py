"""The machine and the process that measure: one core, no garbage collection, and what a reader must know of both."""

from __future__ import annotations

import gc
import os
import platform
import sys
from importlib import metadata
from pathlib import Path

LIBRARIES = ("numpy", "osqp", "cantools", "python-can")
"""Other people's code inside a cycle, or around it."""
_CORES = os.sched_getaffinity(0)
"""The cores that this process had at its start."""


def be_quiet(core: int) -> None:
    """Keep this process on `core`, and leave its garbage alone from now on; what exists already counts as permanent."""
    os.sched_setaffinity(0, {core})
    gc.collect()
    gc.freeze()
    gc.disable()


def apart(process: int) -> None:
    """Give `process` another core than this one, where there is another."""
    own = os.sched_getaffinity(0)
    os.sched_setaffinity(process, (_CORES - own) or own)


def last_core() -> int:
    """Return the last processor that this process may use: the first ones serve most interrupts."""
    return max(os.sched_getaffinity(0))


def build() -> str:
    """Return which build of the positioner this process runs."""
    from positioner.cycle import step  # noqa: PLC0415 - only a worker has the build that it is to name

    return "interpreted" if str(step.__file__).endswith(".py") else "compiled"


def versions() -> dict[str, str]:
    """Return the version of Python, and of the libraries that take part in a cycle."""
    return {"Python": sys.version} | {name: metadata.version(name) for name in LIBRARIES}


def processor() -> str:
    """Return the name of the processor, and how many of them there are."""
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return f"{os.cpu_count()} × {line.partition(':')[2].strip()}"
    return f"{os.cpu_count()} × {platform.machine()}"
