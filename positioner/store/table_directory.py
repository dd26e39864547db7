"""The tables in a state directory: the one in use, the good copy, the backups, and the tables moved aside."""

from __future__ import annotations

import errno
import os
import sqlite3
from typing import TYPE_CHECKING

from positioner.errors import StateError
from positioner.machine import kept_files
from positioner.store import database, document, file_check
from positioner.store.content import StoredTable
from positioner.store.file_check import Fault, TableRejectedError
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from pathlib import Path

TABLE = "stiction.sqlite"
GOOD_COPY = "stiction.good.sqlite"
BACKUPS = "backups"

WRITING_FAILED = (OSError, sqlite3.Error, StateError)

_NO_SPACE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_NO_PERMISSION = {errno.EACCES, errno.EPERM, errno.EROFS}


class TableDirectory:
    """The tables of one valve in its directory; its user holds the directory's lock.

    A method that cannot write raises one of `WRITING_FAILED`; the table on the disk is then still complete, and the
    same call may be tried again.
    """

    def __init__(self, directory: Path, valve_id: str, cell_width_m: float) -> None:
        self._directory = directory
        self._valve_id = valve_id
        self._cell_width_m = cell_width_m
        self._path = directory / TABLE
        self._connection: sqlite3.Connection | None = None
        self._inode = 0
        self._on_disk: StoredTable | None = None
        self._attempted: StoredTable | None = None
        self._copied: StoredTable | None = None
        self._notices: list[str] = []

    def load(self) -> StoredTable:
        """Return the valve's table, else its good copy, else an empty table; nothing is written.

        Raises:
            StateError: there is a table that this user may not read.
        """
        try:
            self._on_disk = self._read(self._path)
        except TableRejectedError as rejected:
            return self._substitute(rejected)
        return self._on_disk

    def save(self, stored: StoredTable) -> None:
        """Commit the table; a file in its place that is not the one last read or written is moved aside first."""
        if self._connection is None or self._replaced():
            self._connect(stored)
        if self._connection and self._on_disk and stored != self._on_disk:
            self._attempted = stored
            try:
                database.update(self._connection, self._on_disk, stored)
            except sqlite3.Error:
                self.close()  # the next attempt reads the file again
                raise
            self._on_disk = stored

    def copy(self, stored: StoredTable) -> None:
        """Write the good copy; one that is not this valve's is moved aside first."""
        path = self._directory / GOOD_COPY
        if self._copied is None:
            try:
                self._copied = self._read(path)
            except TableRejectedError as rejected:
                self._set_aside(rejected)
        if stored != self._copied:
            database.create(path, stored)
            self._copied = stored

    def back_up(self, stored: StoredTable, occasion: str) -> Path:
        """Return the path of a new backup of the table, made before a reset or an import (`occasion`)."""
        place = self._directory / BACKUPS
        place.mkdir(exist_ok=True)
        path = kept_files.unused_name(place, f"before-{occasion}", ".json")
        with path.open("x", encoding="utf-8") as file:
            file.write(document.dumps(stored))
            file.flush()
            os.fsync(file.fileno())
        kept_files.sync(place)
        return path

    def take_notices(self) -> tuple[str, ...]:
        """Return the notices since the last call, a line each."""
        notices, self._notices = tuple(self._notices), []
        return notices

    def close(self) -> None:
        """Close the table's file."""
        if self._connection:
            self._connection.close()
            self._connection = None

    def _read(self, path: Path) -> StoredTable:
        stored = database.read(path)
        if stored.valve_id != self._valve_id:
            detail = f"belongs to valve {stored.valve_id!r}, this is {self._valve_id!r}"
            raise TableRejectedError(path, Fault.OTHER_VALVE, detail)
        if stored.table.cell_width_m != self._cell_width_m:
            detail = f"has cells of {stored.table.cell_width_m:g} m, the configuration says {self._cell_width_m:g} m"
            raise TableRejectedError(path, Fault.OTHER_CELL_WIDTH, detail)
        return stored

    def _substitute(self, rejected: TableRejectedError) -> StoredTable:
        try:
            stored = self._read(self._directory / GOOD_COPY)
        except TableRejectedError as copy_rejected:
            if rejected.fault is not Fault.MISSING or copy_rejected.fault is not Fault.MISSING:
                self._notices.append(f"{rejected}: starting with an empty table, since {copy_rejected}")
            return StoredTable(self._valve_id, StictionTable(cell_width_m=self._cell_width_m))
        self._notices.append(f"{rejected}: using the last good copy, {GOOD_COPY}, of {stored.table.sequence} samples")
        return stored

    def _replaced(self) -> bool:
        try:
            return self._path.stat().st_ino != self._inode
        except FileNotFoundError:
            return True

    def _connect(self, stored: StoredTable) -> None:
        self.close()
        try:
            found = self._read(self._path)
            if found not in (self._on_disk, self._attempted):
                raise TableRejectedError(self._path, Fault.UNEXPECTED, "was put there by someone else")  # noqa: TRY301
        except TableRejectedError as rejected:
            self._set_aside(rejected)
            database.create(self._path, stored)
            found = stored
        self._on_disk = found
        self._connection = database.connect(self._path)
        self._inode = self._path.stat().st_ino

    def _set_aside(self, rejected: TableRejectedError) -> None:
        # a journal left behind would be rolled back into the next table
        moved = kept_files.set_aside(self._directory, rejected.path.name, rejected.fault, file_check.SIDECARS)
        self._notices += [f"{before} {rejected.detail}: moved aside to {after}" for before, after in moved]


def remedy(error: Exception) -> str:
    """Return why a file could not be written, and what to do about it."""
    why = getattr(error, "strerror", None) or str(error)
    number = getattr(error, "errno", None)
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF  # the primary code
    if number in _NO_SPACE or code == sqlite3.SQLITE_FULL:
        return f"{why}; free some space on the disk"
    if number in _NO_PERMISSION or code in {sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM}:
        return f"{why}; make the state directory writable"
    if code in {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}:
        return f"{why}; close the other program that holds the table"
    return f"{why}; check the disk"
