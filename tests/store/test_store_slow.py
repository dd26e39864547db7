"""A table writer that is silent, and tables that are too large for one cycle of the loop."""

from __future__ import annotations

import json
import os
import signal
from typing import TYPE_CHECKING

import pytest
from store_helpers import VALVE, WIDTH_M, opened, series, taught, wait_for

from positioner.errors import ConfigurationError
from positioner.store import access, database, document, messages
from positioner.store.messages import Replaced, SavingFailed, SavingWorks
from positioner.store.table_directory import TABLE
from positioner.valve.stiction import MOST_CELLS, Direction, LearnedSample, Quantity

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from positioner.store.client import TableWriterClient
    from positioner.store.content import StoredTable

_FAR_S = 1e6
"""An instant far from the machine's own, so that only the instants given count."""


def large(cells: int) -> StoredTable:
    samples = [
        LearnedSample(quantity, WIDTH_M * index, direction, 0.05)
        for index in range(-340, 350)
        for quantity in Quantity
        for direction in Direction
    ]
    return taught(samples[:cells], VALVE)


def test_a_table_writer_that_hangs_is_reported_and_then_replaced_and_loses_nothing(tmp_path: Path) -> None:
    writer, _, _ = opened(tmp_path)
    wait_for(writer, lambda: writer.saved)
    pid = writer._child.process.pid
    os.kill(pid, signal.SIGSTOP)
    writer.record(series(30))
    assert writer.poll(_FAR_S) == ()
    assert writer.poll(_FAR_S + 2.9) == ()
    (reported,) = writer.poll(_FAR_S + 3.1)
    assert isinstance(reported, SavingFailed)
    assert writer.problem is not None
    assert not writer.saved
    assert writer.poll(_FAR_S + 89.0) == ()
    assert writer._child.process.poll() is None
    writer.poll(_FAR_S + 90.1)
    events = wait_for(writer, lambda: writer.saved)
    assert writer._child.process.pid != pid
    assert SavingWorks() in events
    assert writer.close(10.0) is None
    assert database.read(tmp_path / TABLE).table == taught(series(30)).table


def test_a_table_writer_that_was_only_slow_is_reported_to_work_again(writer: TableWriterClient) -> None:
    wait_for(writer, lambda: writer.saved)
    pid = writer._child.process.pid
    os.kill(pid, signal.SIGSTOP)
    writer.record(series(30))
    writer.poll(_FAR_S)
    writer.poll(_FAR_S + 4.0)
    os.kill(pid, signal.SIGCONT)
    assert SavingWorks() in wait_for(writer, lambda: writer.saved)
    assert writer._child.process.pid == pid


def test_the_largest_table_comes_a_few_lines_at_a_time(
    tmp_path: Path, writer: TableWriterClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    wait_for(writer, lambda: writer.saved)
    access.replace(tmp_path, large(MOST_CELLS), force=False)
    lines = [0]
    feed = messages.Decoder.feed

    def counting(decoder: messages.Decoder, line: bytes) -> messages.Message | None:
        lines[-1] += 1
        return feed(decoder, line)

    monkeypatch.setattr(messages.Decoder, "feed", counting)

    def is_there() -> bool:
        lines.append(0)
        return writer._stored.table.sequence == MOST_CELLS

    polls = wait_for(writer, is_there, 30.0)
    assert [event.stored.table for event in polls if isinstance(event, Replaced)] == [large(MOST_CELLS).table]
    assert max(lines) == 4
    assert sum(lines) > MOST_CELLS / messages.CELLS_PER_LINE


def test_the_largest_table_goes_a_few_lines_at_a_time_to_a_table_writer_that_is_started_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    access.replace(tmp_path, large(MOST_CELLS), force=False)
    writer, table, _ = opened(tmp_path)
    assert table == large(MOST_CELLS).table
    wait_for(writer, lambda: writer.saved)
    sent = [0]
    cells = document.cells

    def counting(stored: StoredTable) -> Iterator[dict[str, object]]:
        for cell in cells(stored):
            sent[-1] += 1
            yield cell

    monkeypatch.setattr(document, "cells", counting)
    writer._child.process.kill()
    writer._child.process.wait()
    writer.record(series(1))

    def is_saved() -> bool:
        sent.append(0)
        return writer.saved and sum(sent) >= MOST_CELLS

    wait_for(writer, is_saved, 30.0)
    assert max(sent) == 4 * messages.CELLS_PER_LINE
    assert writer.close(10.0) is None
    assert access.dump(tmp_path).table.sequence == MOST_CELLS + 1


def test_a_table_with_a_cell_too_many_is_refused_and_no_sample_makes_one() -> None:
    full = large(MOST_CELLS)
    assert len(full.table) == MOST_CELLS
    more = full.learned(LearnedSample(Quantity.STICK_SPEED, 9.9, Direction.OPENING, 0.05), 0)
    assert more is full
    plain = json.loads(document.dumps(full))
    plain["cells"].append({**plain["cells"][0], "index": 1500})
    with pytest.raises(ConfigurationError, match=f"are too many: a table holds at most {MOST_CELLS}"):
        document.from_plain(plain, "x")
