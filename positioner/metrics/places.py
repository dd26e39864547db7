"""What stands already where metrics are to go: a place of somebody else is refused, and stays as it is. Shell.

A file is ours if its first line is that of our metrics. A socket is left over from before if nobody answers at it. So
the configuration, the table, the page of another program or a live socket are never replaced, nor removed at the end.
"""

from __future__ import annotations

import os
import socket
import stat
from typing import TYPE_CHECKING, TypeAlias

from positioner.metrics.exposition import FIRST_LINE

if TYPE_CHECKING:
    from pathlib import Path

Identity: TypeAlias = tuple[int, int, int]
"""Device, inode and instant of the last change in ns: the number of a removed inode is soon that of another file."""


def identity_of(path: Path) -> Identity | None:
    """Return what has this name now, None where there is nothing that can be seen."""
    try:
        status = path.lstat()
    except OSError:
        return None
    return status.st_dev, status.st_ino, status.st_mtime_ns


def file_problem(path: Path) -> str | None:
    """Return why metrics must not replace what stands at `path`; None where there is nothing, or metrics of ours."""
    try:
        if not stat.S_ISREG(path.lstat().st_mode):
            return "is no plain file, and is left as it is; metrics need a name of their own"
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
            begin = file.read(len(FIRST_LINE))
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        return f"cannot be read, and is left as it is: {error.strerror}; metrics need a file of their own"
    if begin != FIRST_LINE:
        return "holds something other than our metrics, and is left as it is; metrics need a file of their own"
    return None


def socket_problem(path: Path) -> str | None:
    """Return why a socket cannot be made at `path`; None where there is nothing, or one at which nobody answers."""
    try:
        if not stat.S_ISSOCK(path.lstat().st_mode):
            return "something else has this name"
    except OSError:
        return None  # nothing there; where the folder cannot be used, the making of the socket says so
    with socket.socket(socket.AF_UNIX) as asker:
        asker.setblocking(False)
        try:
            asker.connect(str(path))
        except ConnectionRefusedError:
            return None
        except BlockingIOError:  # so many ask there that this one would have to wait
            return "another process answers there"
        except OSError as error:
            return f"it cannot be seen whether another process answers there: {error.strerror or error}"
    return "another process answers there"
