"""Tables to store, and how to wait for a table writer."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import strategies as st

from positioner.store.client import TableWriterClient
from positioner.store.content import StoredTable
from positioner.valve.stiction import Direction, LearnedSample, Quantity, StictionTable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    from positioner.store.client import WriterEvent

VALVE = "FV-101"
WIDTH_M = 0.005
NOW_S = 1_778_312_125


def sample(number: int) -> LearnedSample:
    """Return the `number`-th sample of an endless series over 30 cells, in which no value is repeated."""
    quantity = tuple(Quantity)[number % 3]
    direction = tuple(Direction)[number // 3 % 2]
    _, largest = quantity.limits
    return LearnedSample(quantity, WIDTH_M * (number % 15), direction, largest * (1.0 + number / 1024) * 1e-4)


def series(count: int, start: int = 0) -> list[LearnedSample]:
    return [sample(number) for number in range(start, start + count)]


def taught(samples: Iterable[LearnedSample], valve_id: str = VALVE, width_m: float = WIDTH_M) -> StoredTable:
    stored = StoredTable(valve_id, StictionTable(cell_width_m=width_m))
    for one in samples:
        stored = stored.learned(one, NOW_S)
    return stored


def tables() -> st.SearchStrategy[StoredTable]:
    positions = st.floats(-0.1, 0.2)
    kinds = [
        st.builds(LearnedSample, st.just(quantity), positions, st.sampled_from(Direction), st.floats(*quantity.limits))
        for quantity in Quantity
    ]
    samples = st.one_of(kinds)
    names = st.text(st.characters(codec="utf-8"), min_size=1).filter(str.isprintable)
    widths = st.floats(1e-4, 0.1)
    return st.builds(taught, st.lists(samples, max_size=40), names, widths)


def wait_for(writer: TableWriterClient, done: Callable[[], bool], timeout_s: float = 10.0) -> list[WriterEvent]:
    """Return the events up to the moment at which `done` holds."""
    events: list[WriterEvent] = []
    deadline_s = time.monotonic() + timeout_s
    while True:
        events.extend(writer.poll())
        if done():
            return events
        assert time.monotonic() < deadline_s, events
        select.select([writer._child.channel] if writer._child.channel.fileno() >= 0 else [], [], [], 0.02)


def python(*arguments: object, **options: Any) -> subprocess.Popen[str]:
    """Start this interpreter with all modules that this process can import; the caller reads its output."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment, **options)


def opened(directory: Path, valve_id: str = VALVE) -> tuple[TableWriterClient, StictionTable, tuple[str, ...]]:
    return TableWriterClient.open(directory, valve_id, WIDTH_M)


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[TableWriterClient]:
    """A table writer of the directory `tmp_path`."""
    client, _, _ = opened(tmp_path)
    yield client
    client.close(10.0)
