"""The checks of a file before SQLite may open it as the table, and the faults that a file may have.

The owner of the directory may put any file there: a FIFO that blocks its reader for ever, or a journal that makes
SQLite delete the file that the journal names as its super-journal. This program writes neither.
"""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from enum import StrEnum
from pathlib import Path

from positioner.errors import StateError

SIDECARS = ("-journal", "-wal", "-shm")
_MAGIC = b"SQLite format 3\0"
_HEADER_BYTES = 100
_ROLLBACK_JOURNAL = b"\x01\x01"
_LARGEST_BYTES = 64 * 2**20
"""No table is nearly as large."""
_JOURNAL_MAGIC = bytes.fromhex("d9d505f920a163d7")
"""The first bytes of every journal, and the last ones of a journal that names a super-journal (SQLite file format)."""


class Fault(StrEnum):
    """Why a file is not this valve's table; the value is part of the name under which it is set aside."""

    MISSING = "missing"
    DAMAGED = "damaged"
    FOREIGN = "foreign"
    NEWER_SCHEMA = "newer-schema"
    OTHER_VALVE = "other-valve"
    OTHER_CELL_WIDTH = "other-cell-width"
    UNEXPECTED = "unexpected"


class TableRejectedError(StateError):
    """A file that must not be used as the table: `path`, and `fault` and `detail` saying why."""

    def __init__(self, path: Path, fault: Fault, detail: str) -> None:
        self.path, self.fault, self.detail = path, fault, detail
        super().__init__(f"{path} {detail}")


def check(path: Path) -> None:
    """Check that SQLite may open `path`: a plain file of its format, with no journal or one of this program's kind.

    Raises:
        TableRejectedError: the file is missing or must not be opened.
        StateError: it cannot be read; the message says what to do.
    """
    header = _end_of(path, path, first=_HEADER_BYTES)
    if header is None:
        raise TableRejectedError(path, Fault.MISSING, "does not exist")
    if len(header) < _HEADER_BYTES or not header.startswith(_MAGIC):
        raise TableRejectedError(path, Fault.DAMAGED, "is not an SQLite database")
    if header[18:20] != _ROLLBACK_JOURNAL:  # anything else would make SQLite create files, or refuse to write later
        raise TableRejectedError(path, Fault.DAMAGED, "is damaged: unknown journal format in its header")
    for suffix in SIDECARS:
        if _end_of(path, Path(f"{path}{suffix}"), last=len(_JOURNAL_MAGIC)) == _JOURNAL_MAGIC:
            detail = "is damaged: its journal names a super-journal, a file that SQLite would delete"
            raise TableRejectedError(path, Fault.DAMAGED, detail)


def _end_of(table: Path, path: Path, *, first: int = 0, last: int = 0) -> bytes | None:
    """Return the first or the last bytes of a plain file, None where there is none; it never waits."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
    except FileNotFoundError:
        return None
    except PermissionError as error:
        raise StateError(f"{path}: cannot be read: {error.strerror}; make it readable for this user") from error
    except OSError as error:  # a symbolic link (ELOOP), a socket (ENXIO), a disk that does not read
        raise TableRejectedError(table, Fault.DAMAGED, f"cannot be read: {error.strerror}") from error
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode) or status.st_size > _LARGEST_BYTES:
            detail = f"cannot be read: {path.name} is no plain file of at most {_LARGEST_BYTES >> 20} MiB"
            raise TableRejectedError(table, Fault.DAMAGED, detail)
        with suppress(OSError):
            return os.pread(descriptor, first or last, 0 if first else max(0, status.st_size - last))
        raise TableRejectedError(table, Fault.DAMAGED, "cannot be read: the disk fails")
    finally:
        os.close(descriptor)
