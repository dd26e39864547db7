"""Files by which the owner of a state directory may try to harm its reader: nothing hangs, no other file is touched."""

from __future__ import annotations

import os
import sqlite3
import struct
from contextlib import closing
from types import MappingProxyType
from typing import TYPE_CHECKING

import pytest
from store_helpers import NOW_S, VALVE, WIDTH_M, series, taught

from positioner.store import database, file_check, schema
from positioner.store.content import StoredTable
from positioner.store.file_check import Fault, TableRejectedError
from positioner.store.table_directory import GOOD_COPY, TABLE, TableDirectory
from positioner.valve.stiction import Cell, CellKey, Direction, Quantity, StictionTable

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

KEY = CellKey(Quantity.LANDING_BIAS, 3, Direction.OPENING)


def odd(sequence: int = 1, value: float = 0.01, index: int = 3, valve: str = VALVE) -> StoredTable:
    """A table that this program would never make, to be written with the digest that fits it."""
    key = CellKey(KEY.quantity, index, KEY.direction)
    cells = MappingProxyType({key: Cell((value,), 1, 1)})
    return StoredTable(valve, StictionTable(WIDTH_M, sequence, cells), 0, MappingProxyType({key: NOW_S}))


def forged(path: Path, *statements: str) -> None:
    """Change a table with SQL, and give it the digest that fits."""
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        for statement in statements:
            connection.execute(statement)
        names = [row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        rows = {name: connection.execute(f"SELECT * FROM [{name}]").fetchall() for name in names}  # noqa: S608
        del rows["digest"]
        connection.execute("DELETE FROM digest")
        connection.execute("INSERT INTO digest VALUES (?)", (schema._digest(connection, rows),))


def rejection(path: Path) -> TableRejectedError:
    with pytest.raises(TableRejectedError) as caught:
        database.read(path)
    assert "\n" not in str(caught.value)
    return caught.value


@pytest.mark.parametrize(
    ("stored", "why"),
    [
        (odd(sequence=2**53), "sequence: must be less than or equal to"),
        (odd(value=1.0), "must be from -0.1 to 0.1, not 1.0"),
        (odd(value=1e308), "must be from -0.1 to 0.1"),
        (odd(index=2**40), "lie farther away than 10 m"),
        (odd(valve="a\x00b"), "must be a printable text"),
    ],
)
def test_impossible_values_with_a_right_digest_are_rejected_and_the_good_copy_is_used(
    tmp_path: Path, stored: StoredTable, why: str
) -> None:
    database.create(tmp_path / TABLE, stored)
    database.create(tmp_path / GOOD_COPY, taught(series(20)))
    refused = rejection(tmp_path / TABLE)
    assert refused.fault is Fault.DAMAGED
    assert why in str(refused)
    table_directory = TableDirectory(tmp_path, VALVE, WIDTH_M)
    assert table_directory.load() == taught(series(20))
    (notice,) = table_directory.take_notices()
    assert "using the last good copy" in notice


@pytest.mark.parametrize("name", [TABLE, f"{TABLE}-journal", f"{TABLE}-wal", GOOD_COPY])
@pytest.mark.parametrize(
    ("make", "why"),
    [
        (os.mkfifo, "no plain file"),
        (os.mkdir, "no plain file"),
        (lambda path: path.symlink_to("/dev/zero"), "symbolic links"),
    ],
)
def test_what_is_no_plain_file_is_refused_at_once(
    tmp_path: Path, name: str, make: Callable[[Path], None], why: str
) -> None:
    database.create(tmp_path / TABLE, taught(series(20)))
    database.create(tmp_path / GOOD_COPY, taught(series(20)))
    (tmp_path / name).unlink(missing_ok=True)
    make(tmp_path / name)
    refused = rejection(tmp_path / (GOOD_COPY if name == GOOD_COPY else TABLE))
    assert refused.fault is Fault.DAMAGED
    assert why in str(refused)
    table_directory = TableDirectory(tmp_path, VALVE, WIDTH_M)
    assert table_directory.load() == taught(series(20))
    table_directory.save(taught(series(21)))
    table_directory.copy(taught(series(21)))
    table_directory.close()
    assert database.read(tmp_path / TABLE) == database.read(tmp_path / GOOD_COPY) == taught(series(21))


def hot_journal(path: Path, super_journal: Path) -> None:
    """Leave the journal of an unfinished transaction beside `path`, one that names `super_journal` at its end."""
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute("PRAGMA synchronous = OFF")
        connection.execute("BEGIN IMMEDIATE")
        connection.execute("UPDATE meta SET generation = generation + 1")
        connection.execute("PRAGMA cache_spill = 1")
        pages = path.stat().st_size // connection.execute("PRAGMA page_size").fetchone()[0]
        connection.execute("ROLLBACK")
    name = os.fsencode(super_journal)
    size = 4096
    nonce = 7
    header = struct.pack(">8sIIIII", file_check._JOURNAL_MAGIC, 0, nonce, pages, 512, size).ljust(512, b"\0")
    lock_page = 2**30 // size + 1
    checksum = sum(name) & 0xFFFFFFFF
    tail = struct.pack(f">I{len(name)}sII8s", lock_page, name, len(name), checksum, file_check._JOURNAL_MAGIC)
    path.with_name(f"{path.name}-journal").write_bytes(header + tail)


def test_a_journal_cannot_make_a_reader_delete_a_file(tmp_path: Path) -> None:
    victim = tmp_path / "elsewhere" / "victim"
    victim.parent.mkdir()
    victim.write_text("precious")
    path = tmp_path / TABLE
    database.create(path, taught(series(20)))
    hot_journal(path, victim)
    assert rejection(path).fault is Fault.DAMAGED
    with pytest.raises(TableRejectedError, match="names a super-journal"):
        database.connect(path)
    table_directory = TableDirectory(tmp_path, VALVE, WIDTH_M)
    table_directory.load()
    table_directory.save(taught(series(21)))
    table_directory.close()
    assert victim.read_text() == "precious"
    assert len(list(tmp_path.glob("stiction.damaged-*-journal"))) == 1


def test_sqlite_alone_would_delete_the_file_that_the_planted_journal_names(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    path = tmp_path / TABLE
    database.create(path, taught(series(20)))
    hot_journal(path, victim)
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("SELECT * FROM meta").fetchall()
    assert not victim.exists()


LONG = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n LIMIT 1000000) SELECT count(i) FROM n"


@pytest.mark.parametrize(
    "statements",
    [
        (f"CREATE VIEW extra AS {LONG}",),
        (f"CREATE TRIGGER extra AFTER DELETE ON meta BEGIN INSERT INTO digest {LONG}; END",),
        ("CREATE TABLE extra (i)",),
        ("CREATE INDEX extra ON cells (count)",),
        ('CREATE TABLE "x"" UNION SELECT 1 --" (i)',),
        ("CREATE TABLE extra (i)", "PRAGMA user_version = 99"),
    ],
)
def test_a_file_with_anything_but_our_tables_is_refused(tmp_path: Path, statements: tuple[str, ...]) -> None:
    path = tmp_path / TABLE
    database.create(path, taught(series(20)))
    forged(path, *statements)
    assert rejection(path).fault is (Fault.NEWER_SCHEMA if len(statements) == 2 else Fault.DAMAGED)


def test_sql_in_the_name_of_a_table_of_a_newer_version_is_not_run(tmp_path: Path) -> None:
    path = tmp_path / TABLE
    database.create(path, taught(series(20)))
    forged(path, f'CREATE TABLE "meta, ({LONG})" (i)', "PRAGMA user_version = 99")
    asked: list[str] = []
    with closing(sqlite3.connect(path)) as connection:
        connection.set_trace_callback(asked.append)
        assert not schema.is_whole(connection)
    assert asked
    assert not [statement for statement in asked if "RECURSIVE" in statement]


def test_a_file_that_would_never_end_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / TABLE
    database.create(path, taught(series(20)))
    monkeypatch.setattr(database, "_MOST_CALLS", 3)
    monkeypatch.setattr(schema, "is_whole", lambda connection: connection.execute(LONG).fetchall())
    assert "interrupted" in str(rejection(path))
