from __future__ import annotations

import errno
import sqlite3
from typing import TYPE_CHECKING

import pytest
from store_helpers import NOW_S, VALVE, WIDTH_M, sample, series, taught

from positioner.store import database, document, table_directory
from positioner.store.table_directory import GOOD_COPY, TABLE, TableDirectory, remedy

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.store.content import StoredTable


def _table_directory(directory: Path, valve_id: str = VALVE, width_m: float = WIDTH_M) -> TableDirectory:
    return TableDirectory(directory, valve_id, width_m)


def _saved(directory: Path, stored: StoredTable) -> None:
    one = TableDirectory(directory, stored.valve_id, stored.table.cell_width_m)
    one.load()
    one.save(stored)
    one.close()
    one.take_notices()


def _asides(directory: Path) -> list[str]:
    return sorted(
        path.name for path in directory.iterdir() if path.name not in {TABLE, GOOD_COPY, table_directory.BACKUPS}
    )


def test_a_new_directory_holds_an_empty_table_and_nothing_is_said_about_it(tmp_path: Path) -> None:
    one = _table_directory(tmp_path)
    stored = one.load()
    assert (stored.valve_id, len(stored.table), stored.table.cell_width_m) == (VALVE, 0, WIDTH_M)
    assert list(tmp_path.iterdir()) == []
    one.save(stored)
    one.close()
    assert one.take_notices() == ()
    assert database.read(tmp_path / TABLE) == stored


def test_what_one_table_directory_saved_the_next_one_loads(tmp_path: Path) -> None:
    stored = taught(series(100))
    _saved(tmp_path, stored)
    assert _table_directory(tmp_path).load() == stored


@pytest.mark.parametrize(
    ("valve_id", "width_m", "fault", "why"),
    [
        ("FV-202", WIDTH_M, "other-valve", "belongs to valve 'FV-101', this is 'FV-202'"),
        (VALVE, 0.004, "other-cell-width", "has cells of 0.005 m, the configuration says 0.004 m"),
    ],
)
def test_a_table_that_is_not_this_valves_is_moved_aside_with_its_good_copy(
    tmp_path: Path, valve_id: str, width_m: float, fault: str, why: str
) -> None:
    stored = taught(series(20))
    _saved(tmp_path, stored)
    database.create(tmp_path / GOOD_COPY, stored)
    one = _table_directory(tmp_path, valve_id, width_m)
    fresh = one.load()
    assert len(fresh.table) == 0
    assert any(f"{TABLE} {why}: starting with an empty table" in notice for notice in one.take_notices())
    one.save(fresh)
    one.copy(fresh)
    one.close()
    names = _asides(tmp_path)
    assert [name.startswith(f"stiction.{fault}-") for name in names] == [True, True]
    assert [database.read(tmp_path / name) for name in names] == [stored, stored]
    notices = one.take_notices()
    assert all(any(str(tmp_path / name) in notice for notice in notices) for name in names)
    assert database.read(tmp_path / TABLE) == database.read(tmp_path / GOOD_COPY) == fresh


def test_a_damaged_table_is_moved_aside_and_the_good_copy_is_used(tmp_path: Path) -> None:
    stored = taught(series(20))
    _saved(tmp_path, stored)
    database.create(tmp_path / GOOD_COPY, stored)
    (tmp_path / TABLE).write_bytes(b"garbage")
    (tmp_path / f"{TABLE}-journal").write_bytes(b"a journal that must not meet the new table")
    one = _table_directory(tmp_path)
    assert one.load() == stored
    (notice,) = one.take_notices()
    assert "is not an SQLite database: using the last good copy, stiction.good.sqlite, of 20 samples" in notice
    assert (tmp_path / TABLE).read_bytes() == b"garbage"
    one.save(stored)
    one.close()
    damaged, journal = _asides(tmp_path)
    assert damaged.startswith("stiction.damaged-")
    assert journal == f"{damaged}-journal"
    assert (tmp_path / damaged).read_bytes() == b"garbage"
    assert database.read(tmp_path / TABLE) == stored


def test_a_missing_table_comes_back_from_the_good_copy(tmp_path: Path) -> None:
    stored = taught(series(20))
    database.create(tmp_path / GOOD_COPY, stored)
    one = _table_directory(tmp_path)
    assert one.load() == stored
    assert "does not exist: using the last good copy" in one.take_notices()[0]


def test_tables_moved_aside_in_the_same_second_never_overwrite_each_other(tmp_path: Path) -> None:
    for number in range(12):
        (tmp_path / TABLE).write_bytes(b"%d" % number)
        one = _table_directory(tmp_path)
        one.save(one.load())
        one.close()
    contents = {(tmp_path / name).read_bytes() for name in _asides(tmp_path)}
    assert contents == {b"%d" % number for number in range(12)}


def test_a_table_that_someone_puts_in_the_place_of_the_open_one_is_moved_aside(tmp_path: Path) -> None:
    mine, theirs = taught(series(20)), taught(series(7))
    one = _table_directory(tmp_path)
    one.load()
    one.save(mine)
    database.create(tmp_path / TABLE, theirs)
    one.save(more := mine.learned(sample(50), NOW_S))
    one.close()
    (aside,) = _asides(tmp_path)
    assert aside.startswith("stiction.unexpected-")
    assert database.read(tmp_path / aside) == theirs
    assert database.read(tmp_path / TABLE) == more


def test_a_table_deleted_under_a_running_table_directory_is_written_again(tmp_path: Path) -> None:
    one = _table_directory(tmp_path)
    one.save(stored := one.load())
    (tmp_path / TABLE).unlink()
    one.save(stored)
    one.close()
    assert database.read(tmp_path / TABLE) == stored


@pytest.mark.parametrize("committed", [False, True])
def test_a_save_that_failed_is_repeated_whether_it_had_reached_the_disk_or_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, committed: bool
) -> None:
    update = database.update

    def failing(connection: sqlite3.Connection, before: StoredTable, after: StoredTable) -> None:
        if committed:
            update(connection, before, after)
        raise sqlite3.OperationalError("disk I/O error")

    one = _table_directory(tmp_path)
    one.save(one.load())
    monkeypatch.setattr(database, "update", failing)
    with pytest.raises(sqlite3.OperationalError):
        one.save(taught(series(5)))
    monkeypatch.undo()
    one.save(stored := taught(series(9)))
    one.close()
    assert _asides(tmp_path) == []
    assert one.take_notices() == ()
    assert database.read(tmp_path / TABLE) == stored


def test_backups_of_the_same_second_are_files_of_their_own(tmp_path: Path) -> None:
    tables = [taught(series(count)) for count in range(1, 5)]
    paths = [_table_directory(tmp_path).back_up(stored, "reset") for stored in tables]
    assert [document.loads(path.read_text(encoding="utf-8"), "x") for path in paths] == tables


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), "No space left on device; free some space on the disk"),
        (OSError(errno.EROFS, "Read-only file system"), "make the state directory writable"),
        (OSError(errno.EIO, "Input/output error"), "check the disk"),
    ],
)
def test_a_failure_to_write_comes_with_its_remedy(error: OSError, words: str) -> None:
    assert remedy(error).endswith(words)


def test_a_read_only_database_comes_with_its_remedy(tmp_path: Path) -> None:
    database.create(tmp_path / TABLE, taught(series(1)))
    connection = sqlite3.connect(f"{(tmp_path / TABLE).as_uri()}?mode=ro", uri=True)
    with pytest.raises(sqlite3.OperationalError) as caught:
        connection.execute("DELETE FROM cells")
    connection.close()
    assert remedy(caught.value) == "attempt to write a readonly database; make the state directory writable"
