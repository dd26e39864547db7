"""The table writer on a disk that fails on demand. The file $WRITER_FAULT names the fault; if empty, the disk works.

full        a commit or a sync finds no space (ENOSPC, SQLITE_FULL)
fsync       a commit or a sync fails (EIO, SQLITE_IOERR_FSYNC)
no-rights   the table writer runs as the user nobody, so that the permissions of its directory apply

Each statement that fails adds a byte to the file `refused` beside it.
"""

from __future__ import annotations

import errno
import os
import sqlite3
from pathlib import Path
from typing import Any

from positioner.store import writer

_FAULT = Path(os.environ["WRITER_FAULT"])
_NOBODY = 65534
_AM_ROOT = os.geteuid() == 0
_ERRORS = {
    "full": (errno.ENOSPC, sqlite3.SQLITE_FULL, "database or disk is full"),
    "fsync": (errno.EIO, sqlite3.SQLITE_IOERR_FSYNC, "disk I/O error"),
}


def _fault() -> str:
    """Return the present fault; root becomes the user nobody for "no-rights", and root again for any other fault."""
    word = _FAULT.read_text("ascii")
    if _AM_ROOT and (wanted := _NOBODY if word == "no-rights" else 0) != os.geteuid():
        os.seteuid(wanted)
    return word


def _count() -> None:
    with _FAULT.with_name("refused").open("ab") as file:
        file.write(b".")


class FaultyConnection(sqlite3.Connection):
    """A connection whose commits fail on demand, before anything of them is on the disk."""

    def execute(self, sql: str, *parameters: Any) -> sqlite3.Cursor:
        word = _fault()
        if sql == "COMMIT" and word in _ERRORS:
            _, code, text = _ERRORS[word]
            error = sqlite3.OperationalError(text)
            error.sqlite_errorcode = code
            _count()
            raise error
        return self._counted(sql, *parameters)

    def _counted(self, sql: str, *parameters: Any) -> sqlite3.Cursor:
        try:
            return super().execute(sql, *parameters)
        except sqlite3.OperationalError:
            _count()
            raise


_connect, _fsync = sqlite3.connect, os.fsync


def _faulty_connect(*arguments: Any, **options: Any) -> sqlite3.Connection:
    _fault()
    return _connect(*arguments, factory=FaultyConnection, **options)


def _faulty_fsync(descriptor: int) -> None:
    word = _fault()
    if word in _ERRORS:
        raise OSError(_ERRORS[word][0], os.strerror(_ERRORS[word][0]))
    _fsync(descriptor)


if __name__ == "__main__":
    sqlite3.connect = _faulty_connect  # type: ignore[assignment]
    os.fsync = _faulty_fsync  # type: ignore[assignment]
    writer.main()
