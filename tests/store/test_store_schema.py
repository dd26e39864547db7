"""Every schema that was ever released is read, migrated and used; a new one needs a golden table of its own."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING

import golden_table
import pytest
from golden_table import PRESENT
from store_helpers import WIDTH_M, sample, wait_for

from positioner.store import access, database, schema
from positioner.store.client import TableWriterClient
from positioner.store.table_directory import TABLE
from positioner.valve.stiction import SAMPLES_KEPT

if TYPE_CHECKING:
    from pathlib import Path

VERSIONS = range(1, PRESENT + 1)


@pytest.fixture(params=VERSIONS)
def version(request: pytest.FixtureRequest, tmp_path: Path) -> int:
    """A schema, whose golden table is in the state directory."""
    version: int = request.param
    shutil.copyfile(golden_table.sqlite_file(version), tmp_path / TABLE)
    return version


def layout(path: Path) -> tuple[int, int, list[tuple[str, ...]]]:
    """Return the mark, the schema's number and all that it defines."""
    with closing(sqlite3.connect(path)) as connection:
        ((mark,),) = connection.execute("PRAGMA application_id")
        rows = connection.execute("SELECT type, name, tbl_name, sql FROM sqlite_master ORDER BY type, name")
        return mark, schema.version_of(connection), rows.fetchall()


def test_every_schema_has_a_golden_table_and_no_golden_table_is_of_the_future() -> None:
    stored = {path.name for path in golden_table.FOLDER.iterdir()}
    assert stored == {f"v{version}.{kind}" for version in VERSIONS for kind in ("sqlite", "json")}


def test_a_golden_table_is_of_the_schema_that_its_name_says(version: int, tmp_path: Path) -> None:
    mark, found, _ = layout(tmp_path / TABLE)
    assert (mark, found) == (0x53544943, version)


def test_a_schema_that_changed_needs_a_migration_and_a_golden_table(tmp_path: Path) -> None:
    database.create(tmp_path / TABLE, golden_table.example())
    assert layout(tmp_path / TABLE) == layout(golden_table.sqlite_file(PRESENT))


def test_a_table_of_any_released_version_is_read_as_it_was_written(version: int, tmp_path: Path) -> None:
    whole = (tmp_path / TABLE).read_bytes()
    assert database.read(tmp_path / TABLE) == access.dump(tmp_path) == golden_table.content(version)
    assert (tmp_path / TABLE).read_bytes() == whole


def test_a_daemon_takes_a_table_of_any_released_version_over_without_a_notice(version: int, tmp_path: Path) -> None:
    before = golden_table.content(version)
    writer, table, notices = TableWriterClient.open(tmp_path, before.valve_id, WIDTH_M)
    assert (replace(table, fit=before.table.fit), notices) == (before.table, ())  # its fit has aged
    writer.record([sample(9)])
    wait_for(writer, lambda: writer.saved, 60.0)
    assert writer.close(60.0) is None
    after = database.read(tmp_path / TABLE)
    one = sample(9)
    assert after.table == before.table.learned(one)
    assert (after.valve_id, after.generation) == (before.valve_id, before.generation)
    assert layout(tmp_path / TABLE) == layout(golden_table.sqlite_file(PRESENT))


def test_the_golden_table_holds_every_quantity_in_both_directions_and_full_cells() -> None:
    cells = dict(golden_table.content(PRESENT).table)
    assert {(key.quantity, key.direction) for key in cells} == {
        (key.quantity, key.direction) for key, _ in golden_table.example().table
    }
    assert min(key.index for key in cells) < 0
    assert max(cell.count for cell in cells.values()) > SAMPLES_KEPT
