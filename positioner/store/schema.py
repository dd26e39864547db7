"""The tables inside the SQLite file: their migrations, their rows, and the digest that guards them."""

from __future__ import annotations

import hashlib
import json
from contextlib import contextmanager
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeAlias

from positioner.stiction import Cell, CellKey, Direction, Quantity, StictionTable
from positioner.store.content import StoredTable

if TYPE_CHECKING:
    import sqlite3
    from collections.abc import Callable, Iterator

APPLICATION_ID = 0x53544943  # "STIC"

_Row: TypeAlias = tuple[Any, ...]


def _create_tables(connection: sqlite3.Connection) -> None:
    connection.execute(
        "CREATE TABLE meta (valve TEXT NOT NULL, cell_width_m REAL NOT NULL, generation INTEGER NOT NULL,"
        " sequence INTEGER NOT NULL)"
    )
    connection.execute(
        "CREATE TABLE cells (quantity TEXT NOT NULL, cell_index INTEGER NOT NULL, direction TEXT NOT NULL,"
        " samples TEXT NOT NULL, count INTEGER NOT NULL, sequence INTEGER NOT NULL, recorded_s INTEGER NOT NULL,"
        " PRIMARY KEY (quantity, cell_index, direction)) WITHOUT ROWID"
    )
    connection.execute("CREATE TABLE digest (sha256 TEXT NOT NULL)")


MIGRATIONS: tuple[Callable[[sqlite3.Connection], None], ...] = (_create_tables,)
"""Step n takes schema n to n + 1; a new file takes all of them. `user_version` counts the steps taken."""


@contextmanager
def transaction(connection: sqlite3.Connection) -> Iterator[None]:
    """Commit what the `with` block does, or nothing of it."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        connection.rollback()
        raise


def version_of(connection: sqlite3.Connection) -> int:
    """Return how many migrations the file has taken."""
    return int(_pragma(connection, "user_version"))


def is_ours(connection: sqlite3.Connection) -> bool:
    """Return whether this program made the file."""
    return bool(_pragma(connection, "application_id") == APPLICATION_ID)


def migrate(connection: sqlite3.Connection) -> None:
    """Take the steps that the file has not taken yet, inside the caller's transaction."""
    for number in range(version_of(connection), len(MIGRATIONS)):
        MIGRATIONS[number](connection)
        connection.execute(f"PRAGMA user_version = {number + 1}")


def stored_in(connection: sqlite3.Connection) -> StoredTable:
    """Return the table in a file of the current schema."""
    ((valve_id, cell_width_m, generation, sequence),) = connection.execute("SELECT * FROM meta")
    cells, recorded_s = {}, {}
    for quantity, index, direction, samples, count, newest, seconds in connection.execute("SELECT * FROM cells"):
        key = CellKey(Quantity(quantity), index, Direction(direction))
        cells[key] = Cell(tuple(json.loads(samples)), count, newest)
        recorded_s[key] = seconds
    table = StictionTable(cell_width_m, sequence, MappingProxyType(cells))
    return StoredTable(valve_id, table, generation, MappingProxyType(recorded_s))


def write(connection: sqlite3.Connection, before: StoredTable | None, after: StoredTable) -> None:
    """Turn the rows of `before` into those of `after`, and their digest."""
    old, new = _cell_rows(before) if before else {}, _cell_rows(after)
    connection.execute("DELETE FROM meta")
    connection.execute("INSERT INTO meta VALUES (?, ?, ?, ?)", _meta_row(after))
    connection.executemany(
        "DELETE FROM cells WHERE quantity = ? AND cell_index = ? AND direction = ?",
        [(key.quantity, key.index, key.direction) for key in old.keys() - new.keys()],
    )
    connection.executemany(
        "INSERT OR REPLACE INTO cells VALUES (?, ?, ?, ?, ?, ?, ?)",
        [row for key, row in new.items() if row != old.get(key)],
    )
    # From memory, not read back: rows that decayed on the disk meanwhile must not get a digest that fits them.
    digest = _digest(connection, {"meta": [_meta_row(after)], "cells": list(new.values())})
    connection.execute("DELETE FROM digest")
    connection.execute("INSERT INTO digest VALUES (?)", (digest,))


def is_whole(connection: sqlite3.Connection) -> bool:
    """Return whether all rows are those that the digest was made of, whatever the schema's version."""
    names = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table' AND name <> 'digest'").fetchall()
    rows = {name: connection.execute(f'SELECT * FROM "{name}"').fetchall() for (name,) in names}  # noqa: S608, names come from the file
    return connection.execute("SELECT * FROM digest").fetchall() == [(_digest(connection, rows),)]


def _digest(connection: sqlite3.Connection, rows: dict[str, list[_Row]]) -> str:
    schema = connection.execute("SELECT type, name, tbl_name, sql FROM sqlite_master").fetchall()
    content = [version_of(connection), sorted(schema), {name: sorted(map(json.dumps, rows[name])) for name in rows}]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _meta_row(stored: StoredTable) -> _Row:
    return stored.valve_id, stored.table.cell_width_m, stored.generation, stored.table.sequence


def _cell_rows(stored: StoredTable) -> dict[CellKey, _Row]:
    return {
        key: (
            *(str(key.quantity), key.index, str(key.direction)),
            *(json.dumps(cell.samples), cell.count, cell.sequence, stored.recorded_s[key]),
        )
        for key, cell in stored.table
    }


def _pragma(connection: sqlite3.Connection, name: str) -> Any:
    return connection.execute(f"PRAGMA {name}").fetchone()[0]
