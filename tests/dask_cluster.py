"""A Dask cluster of this machine, on the loopback only: a scheduler, and workers that nobody starts again."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_HERE = ("--host", "127.0.0.1", "--no-dashboard", "--dashboard-address", "127.0.0.1:0")


@dataclass(frozen=True)
class DaskCluster:
    """The address of the scheduler, its process, and its workers."""

    address: str
    scheduler: subprocess.Popen[str]
    workers: tuple[subprocess.Popen[str], ...]


@contextmanager
def dask_cluster(folder: Path, workers: int = 2) -> Iterator[DaskCluster]:
    """Hold a cluster inside a `with` block; its workers write into `folder`, and can import the tests."""
    with ExitStack() as stack:
        scheduler = stack.enter_context(_program("scheduler", "--port", "0"))
        address = _said(scheduler, r"Scheduler at:\s+(tcp://127\.0\.0\.1:\d+)")
        # without a scheduler a worker ends soon, also when nobody is left to kill it
        alone = ("--no-nanny", "--nthreads", "1", "--death-timeout", "30", "--local-directory", str(folder))
        started = tuple(stack.enter_context(_program("worker", address, *alone)) for _ in range(workers))
        for worker in started:
            _said(worker, r"Registered to:\s+(tcp://\S+)")
        yield DaskCluster(address, scheduler, started)


@contextmanager
def _program(name: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-m", f"distributed.cli.dask_{name}", *_HERE, *arguments]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment) as process:
        try:
            yield process
        finally:
            process.kill()


def _said(process: subprocess.Popen[str], pattern: str) -> str:
    """Return the group of `pattern` in the next line that has it; the lines after it fit into the pipe."""
    assert process.stderr is not None
    read = []
    for line in process.stderr:
        read.append(line)
        if found := re.search(pattern, line):
            return found[1]
    raise AssertionError("".join(read))
