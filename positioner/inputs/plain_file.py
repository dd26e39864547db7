"""A file that somebody else may have made, opened so that no reader waits for it or reads for ever. Shell."""

from __future__ import annotations

import errno
import os
import stat
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from pathlib import Path

MOST_MIB = 256
"""Memory in MiB that reading a log may take, unless somebody allows more."""
_KINDS = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def open_plainly(path: Path) -> BinaryIO:
    """Return a regular file, open for reading; links to one are followed.

    Raises:
        OSError: it cannot be opened, or is a directory, a FIFO, a socket or a device.
    """
    _check(path.stat())  # before: a device may act when it is opened
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    try:
        _check(os.fstat(descriptor))  # and after: another file may have come to this place
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_plainly(path: Path, most_bytes: int) -> bytes:
    """Return the content of a regular file, and one byte more than `most_bytes` where it is larger.

    Raises:
        OSError: as `open_plainly`, or it cannot be read.
    """
    with open_plainly(path) as file:
        return file.read(most_bytes + 1)


def _check(status: os.stat_result) -> None:
    kind = stat.S_IFMT(status.st_mode)
    if kind == stat.S_IFDIR:
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if kind != stat.S_IFREG:
        raise OSError(errno.EINVAL, f"is {_KINDS.get(kind, 'something else')}, and only a regular file is read")
