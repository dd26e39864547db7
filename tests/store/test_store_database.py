from __future__ import annotations

import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, given, settings
from store_helpers import WIDTH_M, sample, series, tables, taught

from positioner.errors import StateError
from positioner.store import database, schema
from positioner.store.file_check import Fault, TableRejectedError
from positioner.store.table_directory import TABLE, TableDirectory

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.store.content import StoredTable


@given(tables(), tables())
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_created_and_updated_is_read_back(tmp_path: Path, first: StoredTable, second: StoredTable) -> None:
    path = tmp_path / TABLE
    database.create(path, first)
    assert database.read(path) == first
    with closing(database.connect(path)) as connection:
        database.update(connection, first, second)
    assert database.read(path) == second


def test_the_file_is_in_the_rollback_mode_that_survives_a_power_cut(tmp_path: Path) -> None:
    database.create(tmp_path / TABLE, taught(series(3)))
    with closing(database.connect(tmp_path / TABLE)) as connection:
        assert connection.execute("PRAGMA journal_mode").fetchone() == ("delete",)
        assert connection.execute("PRAGMA synchronous").fetchone() == (3,)  # EXTRA


def test_every_flipped_byte_is_detected_or_harmless(tmp_path: Path) -> None:
    stored = taught(series(4))
    path = tmp_path / TABLE
    database.create(path, stored)
    whole = path.read_bytes()
    places = [place for place in range(len(whole)) if whole[place] or place < 160 or place % 61 == 0]
    detected = 0
    for place in places:
        for flip in (0xFF, 1 << place % 8):
            path.write_bytes(whole[:place] + bytes([whole[place] ^ flip]) + whole[place + 1 :])
            detected += not _reads(path, stored)
    assert 1000 < detected < 2 * len(places)
    assert sorted(child.name for child in tmp_path.iterdir()) == [TABLE]


def test_a_header_byte_whose_flip_is_harmless_does_not_stop_later_saving(tmp_path: Path) -> None:
    stored = taught(series(4))
    path = tmp_path / TABLE
    database.create(path, stored)
    whole = path.read_bytes()
    harmless = 0
    for place in range(108):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        if not _reads(path, stored):
            continue
        harmless += 1
        table_directory = TableDirectory(tmp_path, stored.valve_id, WIDTH_M)
        more = table_directory.load().learned(sample(99), 0)
        table_directory.save(more)
        table_directory.close()
        assert database.read(path) == more, place
    assert 10 < harmless < 80


def test_every_truncation_is_detected(tmp_path: Path) -> None:
    stored = taught(series(4))
    path = tmp_path / TABLE
    database.create(path, stored)
    whole = path.read_bytes()
    for length in (*range(200), *range(200, len(whole), 37), len(whole) - 1):
        path.write_bytes(whole[:length])
        assert not _reads(path, stored), length


def _reads(path: Path, stored: StoredTable) -> bool:
    """Return whether the file is accepted; what is accepted must be what was written."""
    try:
        assert database.read(path) == stored
    except TableRejectedError:
        return False
    return True


def test_an_unfinished_transaction_is_rolled_back_without_touching_the_files(tmp_path: Path) -> None:
    before, after = taught(series(30)), taught(series(60))
    path = tmp_path / TABLE
    database.create(path, before)
    with closing(database.connect(path)) as connection:
        connection.execute("PRAGMA cache_size = 1")  # pages go to the file before the commit
        connection.execute("BEGIN IMMEDIATE")
        schema.write(connection, before, after)
        crashed = {name: (tmp_path / name).read_bytes() for name in (TABLE, f"{TABLE}-journal")}
        connection.rollback()
    whole = path.read_bytes()
    assert crashed[TABLE] != whole
    place = tmp_path / "crashed"
    place.mkdir()
    for name, content in crashed.items():
        (place / name).write_bytes(content)
    assert database.read(place / TABLE) == before
    assert {path.name: path.read_bytes() for path in place.iterdir()} == crashed


def test_a_missing_file_a_foreign_one_and_a_newer_one_are_distinguished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / TABLE
    assert _fault(path) is Fault.MISSING
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("CREATE TABLE things (x)")
    assert _fault(path) is Fault.FOREIGN
    with monkeypatch.context() as newer:
        newer.setattr(schema, "MIGRATIONS", (*schema.MIGRATIONS, _add_index))
        database.create(path, taught(series(3)))
    assert _fault(path) is Fault.NEWER_SCHEMA


def _fault(path: Path) -> Fault:
    with pytest.raises(TableRejectedError) as caught:
        database.read(path)
    return caught.value.fault


def _add_index(connection: sqlite3.Connection) -> None:
    connection.execute("CREATE INDEX newest ON cells (sequence)")


def test_an_older_schema_is_migrated_in_the_transaction_that_saves_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / TABLE
    old = taught(series(3))
    database.create(path, old)
    whole = path.read_bytes()
    present = len(schema.MIGRATIONS)
    monkeypatch.setattr(schema, "MIGRATIONS", (*schema.MIGRATIONS, _add_index))
    assert database.read(path) == old
    assert path.read_bytes() == whole
    new = old.learned(sample(9), 0)
    with closing(database.connect(path)) as connection:
        monkeypatch.setattr(schema, "write", _fails)
        with pytest.raises(ZeroDivisionError):
            database.update(connection, old, new)
        monkeypatch.undo()
        assert schema.version_of(connection) == present
        monkeypatch.setattr(schema, "MIGRATIONS", (*schema.MIGRATIONS, _add_index))
        database.update(connection, old, new)
        assert schema.version_of(connection) == present + 1
    assert database.read(path) == new


def _fails(*_: object) -> None:
    raise ZeroDivisionError


def test_a_table_locked_by_another_program_is_not_taken_for_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(database, "_BUSY_S", 0.0)
    path = tmp_path / TABLE
    database.create(path, taught(series(3)))
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(StateError, match="in use by another program; close it") as caught:
            database.read(path)
    assert not isinstance(caught.value, TableRejectedError)
