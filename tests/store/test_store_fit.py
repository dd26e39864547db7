"""The fit of a valve in the store: kept whole, aged by its time off, cleared by a reset, refused where impossible."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING

import golden_table
import pytest
from golden_table import FIT
from store_helpers import NOW_S, WIDTH_M, sample, series, taught, wait_for

from positioner.cli import table_text
from positioner.errors import ConfigurationError
from positioner.report.text import plain
from positioner.store import access, commands, database, document, messages, schema
from positioner.store.client import TableWriterClient
from positioner.store.table_directory import TABLE

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.store.content import StoredTable

DAY_S = 86_400


def kept() -> StoredTable:
    return taught([*series(5), replace(sample(5), fit=FIT)])


def test_a_table_writer_keeps_the_newest_fit_bit_for_bit(tmp_path: Path) -> None:
    writer, _, _ = TableWriterClient.open(tmp_path, "FV-101", WIDTH_M)
    newer = replace(FIT, spring_n_per_m=52000.1)
    writer.record([replace(sample(1), fit=FIT), replace(sample(2), fit=newer), sample(3)])
    wait_for(writer, lambda: writer.saved, 60.0)
    assert writer.close(60.0) is None

    again, table, notices = TableWriterClient.open(tmp_path, "FV-101", WIDTH_M)
    assert again.close(60.0) is None
    assert (table.fit, notices) == (newer, ())


def test_it_survives_documents_messages_and_the_file(tmp_path: Path) -> None:
    stored = kept()
    database.create(tmp_path / TABLE, stored)

    assert document.loads(document.dumps(stored), "x") == stored
    assert messages.decode(messages.encode(messages.Dumped(stored))) == messages.Dumped(stored)
    assert database.read(tmp_path / TABLE) == stored


def test_a_document_of_schema_1_has_no_fit() -> None:
    assert golden_table.content(1).table.fit is None
    assert golden_table.content(2).table.fit == FIT


@pytest.mark.parametrize(("days", "seconds"), [(0, DAY_S - 1), (0, -5 * DAY_S), (1, DAY_S), (9, 9 * DAY_S + 100)])
def test_its_variances_grow_with_whole_days_off(days: int, seconds: int) -> None:
    fit = kept().table_at(NOW_S + seconds).fit

    assert fit is not None
    assert fit.ff == pytest.approx(FIT.ff + days * (0.02 * FIT.static_n) ** 2)
    assert fit.kk == pytest.approx(FIT.kk + days * (0.002 * FIT.spring_n_per_m) ** 2)
    assert fit.tt == pytest.approx(FIT.tt + days * 0.02**2)
    assert replace(fit, ff=FIT.ff, kk=FIT.kk, tt=FIT.tt, sliding_n2=FIT.sliding_n2) == FIT


def test_a_dump_shows_it_and_a_reset_clears_it(tmp_path: Path) -> None:
    database.create(tmp_path / TABLE, kept())

    shown = plain(table_text.blocks(access.dump(tmp_path)))
    done = commands.on_files(tmp_path, messages.ResetRequest())

    assert "learned from all slips: K 52432 ± 300 N/m, F_s 1693 ± 20 N" in shown
    assert isinstance(done, messages.Done)
    assert access.dump(tmp_path).table.fit is None


@pytest.mark.parametrize(
    ("name", "value", "line"),
    [
        ("spring_n_per_m", -1.0, "x: fit.spring_n_per_m: must be greater than 0, not -1.0"),
        ("ff", float("inf"), "x: fit.ff: must be a finite number, not inf"),
        ("kf", 1e9, "x: fit: the covariance is impossible: a correlation exceeds 1"),
    ],
)
def test_an_impossible_fit_is_one_clear_line(name: str, value: float, line: str) -> None:
    plain = {**document.head(kept()), "cells": list(document.cells(kept()))}
    plain["fit"][name] = value

    with pytest.raises(ConfigurationError) as found:
        document.from_plain(plain, "x")
    assert str(found.value) == line


@pytest.mark.parametrize("rightly", [False, True])
def test_a_damaged_row_is_one_clear_line_and_set_aside(tmp_path: Path, rightly: bool) -> None:
    database.create(tmp_path / TABLE, kept())
    with closing(sqlite3.connect(tmp_path / TABLE)) as connection:
        connection.execute("UPDATE fit SET spring_n_per_m = -5.0")
        if rightly:  # a digest that fits is no proof
            names = ("meta", "cells", "fit")
            rows = {name: connection.execute(f"SELECT * FROM {name}").fetchall() for name in names}  # noqa: S608
            connection.execute("UPDATE digest SET sha256 = ?", (schema._digest(connection, rows),))
        connection.commit()

    writer, table, notices = TableWriterClient.open(tmp_path, "FV-101", WIDTH_M)
    wait_for(writer, lambda: writer.saved, 60.0)
    assert writer.close(60.0) is None

    assert table.fit is None
    assert len(table) == 0
    assert len(notices) == 1
    assert ("impossible value" if rightly else "does not fit its digest") in notices[0]
    assert list(tmp_path.glob("stiction.damaged-*.sqlite"))
