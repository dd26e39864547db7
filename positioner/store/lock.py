"""The lock on a state directory: an flock on the directory itself, so that it works where nothing can be written."""

from __future__ import annotations

import fcntl
import os
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.errors import AlreadyRunningError, StateError
from positioner.store.interpreter import beyond_standard

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_RETRY_S = 0.02


def acquire(directory: Path, timeout_s: float, report: Callable[[str], object] = lambda _line: None) -> int:
    """Return a descriptor of the directory that holds its lock, waiting up to `timeout_s` for another process.

    `report` is called once, with a line that names the other process. Whoever inherits the descriptor holds the lock,
    too; the lock is free when the last copy is closed.

    Raises:
        AlreadyRunningError: another process holds it; the message names it where the system names it.
        StateError: the directory cannot be opened or locked.
    """
    try:
        descriptor = beyond_standard(os.open(directory, os.O_RDONLY | os.O_DIRECTORY))
    except OSError as error:
        message = f"{directory}: the state directory cannot be opened: {error.strerror}"
        raise StateError(message) from error
    deadline_s = time.monotonic() + timeout_s
    waiting = False
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            if time.monotonic() >= deadline_s:
                message = _occupied(directory)
                os.close(descriptor)
                raise AlreadyRunningError(message) from error
            if not waiting:
                report(f"waiting {timeout_s:g} s at most: {_occupied(directory)}")
            waiting = True
            time.sleep(_RETRY_S)
        except OSError as error:
            os.close(descriptor)
            message = f"{directory}: the state directory cannot be locked: {error.strerror}; use a local file system"
            raise StateError(message) from error
        else:
            return descriptor


@contextmanager
def held(directory: Path, timeout_s: float) -> Iterator[None]:
    """Hold the lock of the directory inside a `with` block.

    Raises:
        AlreadyRunningError: as `acquire`.
        StateError: as `acquire`.
    """
    descriptor = acquire(directory, timeout_s)
    try:
        yield
    finally:
        os.close(descriptor)


def holder(directory: Path) -> int | None:
    """Return the process that took the directory's lock, the daemon of its valve; None where none did.

    It is None, too, where the directory cannot be examined or the system does not name the process.
    """
    try:
        status = directory.stat()
        lines = Path("/proc/locks").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    inode = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino}"
    # number, kind, mode, type, process, device:inode, start, end
    fields = (line.split() for line in lines)
    return next((int(one[4]) for one in fields if len(one) > 5 and one[1] == "FLOCK" and one[5] == inode), None)  # noqa: PLR2004, the columns above


def _occupied(directory: Path) -> str:
    pid = holder(directory)
    if pid is None:
        return f"{directory}: in use by another process; stop it, or choose another state directory"
    if not Path(f"/proc/{pid}").exists():
        return f"{directory}: process {pid} has ended, but its table is still being written; try again shortly"
    return f"{directory}: in use by process {pid}; stop it, or choose another state directory"
