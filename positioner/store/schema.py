"""The tables inside the SQLite file: their migrations, their rows, and the digest that guards them."""

from __future__ import annotations

import hashlib
import json
import re
import sqlite3
from contextlib import closing, contextmanager
from dataclasses import fields
from typing import TYPE_CHECKING, Any, TypeAlias

from positioner.store import document
from positioner.valve.stiction import MOST_CELLS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from positioner.store.content import StoredTable
    from positioner.valve.stiction import CellKey

APPLICATION_ID = 0x53544943  # "STIC"

_COLUMNS = tuple(field.name for field in fields(document.PlainCell))
_SCHEMA = "SELECT type, name, tbl_name, sql FROM sqlite_master"

_Row: TypeAlias = tuple[Any, ...]

FIT_NAMES_2 = (
    *("spring_n_per_m", "static_n", "fill_s", "vent_s"),
    *("kk", "kf", "kt", "ff", "ft", "tt", "friction_doubt", "sliding_n", "sliding_n2"),
)
"""The columns of a fit in schema 2: a released schema never changes."""


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


def _create_fit(connection: sqlite3.Connection) -> None:
    """Schema 2: what the law has fitted to the moves of the valve, one row or none.

    The digest is made anew, so that its page stays the last one, whose end is never empty: a file that was cut shows.
    """
    connection.execute("DROP TABLE digest")
    numbers = ", ".join(f"{name} REAL NOT NULL" for name in FIT_NAMES_2)
    connection.execute(f"CREATE TABLE fit ({numbers}, recorded_s INTEGER NOT NULL)")
    connection.execute("CREATE TABLE digest (sha256 TEXT NOT NULL)")


MIGRATIONS: tuple[Callable[[sqlite3.Connection], None], ...] = (_create_tables, _create_fit)
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
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def is_ours(connection: sqlite3.Connection) -> bool:
    """Return whether this program made the file."""
    return bool(connection.execute("PRAGMA application_id").fetchone()[0] == APPLICATION_ID)


def migrate(connection: sqlite3.Connection) -> None:
    """Take the steps that the file has not taken yet, inside the caller's transaction."""
    for number in range(version_of(connection), len(MIGRATIONS)):
        MIGRATIONS[number](connection)
        connection.execute(f"PRAGMA user_version = {number + 1}")


def stored_in(connection: sqlite3.Connection, source: str) -> StoredTable:
    """Return the table in a file of the current schema; `source` names it in the messages.

    Raises:
        ConfigurationError: a value is outside its limits; a correct digest does not exclude that.
        ValueError: the rows are no table at all.
    """
    (meta,) = connection.execute("SELECT * FROM meta")
    rows = connection.execute("SELECT * FROM cells LIMIT ?", (MOST_CELLS + 1,))
    cells = [
        dict(zip(_COLUMNS, (*start, json.loads(samples), count, newest, document.utc_text(seconds)), strict=True))
        for *start, samples, count, newest, seconds in rows
    ]
    head = dict(zip(("valve", "cell_width_m", "generation", "sequence"), meta, strict=True))
    fits = [
        {**dict(zip(FIT_NAMES_2, numbers, strict=True)), "recorded": document.utc_text(seconds)}
        for *numbers, seconds in connection.execute("SELECT * FROM fit LIMIT 2")
    ]
    if len(fits) > 1:
        raise ValueError("it holds two fits of one valve")
    plain = {"format": document.FORMAT, "schema": 2, **head, "fit": fits[0] if fits else None, "cells": cells}
    return document.from_plain(plain, source)


def is_as_made(connection: sqlite3.Connection) -> bool:
    """Return whether the file has the tables that its version makes, and no trigger, view or other table."""
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as fresh:
        for step in MIGRATIONS[: version_of(connection)]:
            step(fresh)
        return sorted(fresh.execute(_SCHEMA)) == sorted(connection.execute(_SCHEMA))


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
    connection.execute("DELETE FROM fit")
    connection.executemany("INSERT INTO fit VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", _fit_rows(after))
    # From memory, not read back: rows that decayed on the disk meanwhile must not get a digest that fits them.
    digest = _digest(connection, {"meta": [_meta_row(after)], "cells": list(new.values()), "fit": _fit_rows(after)})
    connection.execute("DELETE FROM digest")
    connection.execute("INSERT INTO digest VALUES (?)", (digest,))


def is_whole(connection: sqlite3.Connection) -> bool:
    """Return whether all rows are those that the digest was made of, whatever the schema's version."""
    names = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table' AND name <> 'digest'").fetchall()
    if not all(re.fullmatch("[a-z_]{1,32}", name) for (name,) in names):
        return False
    rows = {name: connection.execute(f"SELECT * FROM {name}").fetchall() for (name,) in names}  # noqa: S608, plain words only
    return connection.execute("SELECT * FROM digest").fetchall() == [(_digest(connection, rows),)]


def _digest(connection: sqlite3.Connection, rows: dict[str, list[_Row]]) -> str:
    schema = connection.execute(_SCHEMA).fetchall()
    content = [version_of(connection), sorted(schema), {name: sorted(map(json.dumps, rows[name])) for name in rows}]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _meta_row(stored: StoredTable) -> _Row:
    return stored.valve_id, stored.table.cell_width_m, stored.generation, stored.table.sequence


def _fit_rows(stored: StoredTable) -> list[_Row]:
    fit = stored.table.fit
    return [] if fit is None else [(*(float(getattr(fit, name)) for name in FIT_NAMES_2), stored.fit_recorded_s)]


def _cell_rows(stored: StoredTable) -> dict[CellKey, _Row]:
    return {
        key: (
            *(str(key.quantity), key.index, str(key.direction)),
            *(json.dumps(cell.samples), cell.count, cell.sequence, stored.recorded_s[key]),
        )
        for key, cell in stored.table
    }
