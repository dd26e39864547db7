"""The table as one SQLite file: read with every check, created whole, updated in one transaction.

The rollback journal, not WAL: SQLite before 3.51.3 can corrupt a WAL database that two connections use.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.errors import ConfigurationError, StateError
from positioner.machine import kept_files
from positioner.store import file_check, schema
from positioner.store.file_check import SIDECARS, Fault, TableRejectedError

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.store.content import StoredTable

_BUSY_S = 1.0
_STEPS_PER_CALL, _MOST_CALLS = 10_000, 20_000
"""Instructions of SQLite's machine between two calls of our handler, and the calls after which reading is given up."""


def create(path: Path, stored: StoredTable) -> None:
    """Write the table to `path` as a new file, replacing an older file in one step.

    Raises:
        OSError: it cannot be written; `path` is as before.
        sqlite3.Error: the same.
    """
    fresh = path.with_name(f"{path.name}.new")
    for suffix in ("", *SIDECARS):
        Path(f"{fresh}{suffix}").unlink(missing_ok=True)
    with closing(_connect(fresh)) as connection, schema.transaction(connection):
        connection.execute(f"PRAGMA application_id = {schema.APPLICATION_ID}")
        schema.migrate(connection)
        schema.write(connection, None, stored)
    fresh.replace(path)
    kept_files.sync(path.parent)


def connect(path: Path) -> sqlite3.Connection:
    """Return a connection for writing; a transaction that a crash left unfinished is rolled back.

    Raises:
        TableRejectedError: SQLite must not open the file.
    """
    file_check.check(path)
    return _connect(path)


def _connect(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(path, timeout=_BUSY_S, isolation_level=None)
    connection.execute("PRAGMA journal_mode = DELETE")
    connection.execute("PRAGMA synchronous = EXTRA")
    return connection


def update(connection: sqlite3.Connection, before: StoredTable, after: StoredTable) -> None:
    """Commit the difference between `before`, the file's content, and `after`.

    Raises:
        sqlite3.Error: it cannot be committed.
    """
    with schema.transaction(connection):
        schema.migrate(connection)
        schema.write(connection, before, after)


def read(path: Path) -> StoredTable:
    """Return the table in the file, which stays as it is.

    Raises:
        TableRejectedError: the file is missing, damaged, or not a table of this program.
        StateError: the file cannot be read; the message says what to do.
    """
    file_check.check(path)
    try:
        return _read(path, f"{path.absolute().as_uri()}?mode=ro")
    except sqlite3.OperationalError as error:
        code = getattr(error, "sqlite_errorcode", None)  # text that is not UTF-8 raises the same error without a code
        if code in {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}:
            raise StateError(f"{path}: in use by another program; close it") from error
        if not Path(f"{path}-journal").exists():
            raise TableRejectedError(path, Fault.DAMAGED, f"is damaged: {error}") from error
    return _read_interrupted(path)


def _read_interrupted(path: Path) -> StoredTable:
    """Return the table as it was before an unfinished transaction, rolled back in a copy."""
    shared_memory = Path("/dev/shm")  # noqa: S108, memory works with a full disk, and the name below is unguessable
    place = shared_memory if os.access(shared_memory, os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=place) as directory:
        copy = Path(directory) / path.name
        shutil.copyfile(path, copy)
        shutil.copyfile(f"{path}-journal", f"{copy}-journal")
        try:
            return _read(path, f"{copy.as_uri()}?mode=rw")
        except sqlite3.OperationalError as error:
            raise TableRejectedError(path, Fault.DAMAGED, f"is damaged: {error}") from error


def _read(path: Path, uri: str) -> StoredTable:
    try:
        with closing(sqlite3.connect(uri, uri=True, timeout=_BUSY_S, isolation_level=None)) as connection:
            connection.set_progress_handler(_step_limit(), _STEPS_PER_CALL)
            connection.execute("PRAGMA trusted_schema = OFF")
            connection.execute("BEGIN")  # one snapshot for all that follows
            _verify(path, connection)
            if schema.version_of(connection) == len(schema.MIGRATIONS):
                return schema.stored_in(connection, str(path))
            with closing(sqlite3.connect(":memory:", isolation_level=None)) as copy:
                connection.backup(copy)
                with schema.transaction(copy):
                    schema.migrate(copy)
                return schema.stored_in(copy, str(path))
    except sqlite3.OperationalError:
        raise
    except ConfigurationError as error:
        raise TableRejectedError(path, Fault.DAMAGED, f"holds an impossible value: {error.problems[0]}") from error
    except (sqlite3.Error, ValueError, TypeError, OverflowError, OSError, RecursionError) as error:
        raise TableRejectedError(path, Fault.DAMAGED, f"is damaged: {' '.join(str(error).split())}") from error


def _step_limit() -> Callable[[], int]:
    """Return a handler that stops SQLite after more steps than reading any table needs."""
    calls = iter(range(_MOST_CALLS))
    return lambda: next(calls, None) is None


def _verify(path: Path, connection: sqlite3.Connection) -> None:
    faults = [str(row[0]) for row in connection.execute("PRAGMA integrity_check(1)")]
    if faults != ["ok"]:
        raise TableRejectedError(path, Fault.DAMAGED, f"is damaged: {' '.join(faults[0].split())}")
    if not schema.is_ours(connection):
        raise TableRejectedError(path, Fault.FOREIGN, "is a database of another program")
    version = schema.version_of(connection)
    if version <= len(schema.MIGRATIONS) and not schema.is_as_made(connection):
        raise TableRejectedError(path, Fault.DAMAGED, "is damaged: it has other tables than this program makes")
    if not schema.is_whole(connection):
        raise TableRejectedError(path, Fault.DAMAGED, "is damaged: its content does not fit its digest")
    if version > len(schema.MIGRATIONS):
        known = len(schema.MIGRATIONS)
        detail = f"has schema {version}, this version knows {known}: a newer positioner wrote it"
        raise TableRejectedError(path, Fault.NEWER_SCHEMA, detail)
