"""How the daemon starts its own processes: this interpreter and this package, whatever the current directory holds."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
from pathlib import Path

_PACKAGES = str(Path(__file__).resolve().parents[2])
_FIRST_FREE = 3
_SHIELDED = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}


def shielded(module: str, *arguments: str, descriptors: tuple[int, ...]) -> subprocess.Popen[bytes]:
    """Return a process that runs `module` and inherits the descriptors.

    Blocked signals stay blocked in it: Ctrl-C or a stop of the whole service must not end it before the daemon.

    Raises:
        OSError: it cannot be started.
    """
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, _SHIELDED)
    try:
        return subprocess.Popen(  # noqa: S603 - our own interpreter and module
            command(module, *arguments),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=descriptors,
            env=environment(),
        )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def command(module: str, *arguments: str) -> list[str]:
    """Return the command that runs `module`; -P keeps a `select.py` in the current directory from being imported."""
    return [sys.executable, "-P", "-m", module, *arguments]


def environment() -> dict[str, str]:
    """Return the environment in which the package is found; an empty entry would mean the current directory."""
    given = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    return {**os.environ, "PYTHONPATH": os.pathsep.join([_PACKAGES, *filter(None, given)])}


def beyond_standard(descriptor: int) -> int:
    """Return the descriptor, or a copy above 2 in its place where it has the number of a closed standard stream.

    A child process gets new streams in place of descriptors 0 to 2, and would lose a descriptor that it inherits there.
    """
    if descriptor >= _FIRST_FREE:
        return descriptor
    moved = fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, _FIRST_FREE)
    os.close(descriptor)
    return moved
