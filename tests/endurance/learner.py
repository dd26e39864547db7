"""A process that learns all the time through the daemon's own store, until somebody kills it."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import time
import traceback
from pathlib import Path
from typing import TYPE_CHECKING

from endurance.sample_log import SampleLogWriter
from positioner.errors import StateError
from positioner.store.client import TableWriterClient
from positioner.valve.stiction import Direction, LearnedSample, Quantity

if TYPE_CHECKING:
    from typing import NoReturn

    from positioner.valve.stiction import StictionTable

VALVE = "FV-101"
WIDTH_M = 0.005
_TRAVEL_M = 0.127
_LONGEST_PAUSE_S = 0.004
LONG_S = 600.0
"""The timeout of every wait on a busy machine; normally no wait reaches it."""
TOO_BUSY = "the table writer does not start"
"""The store's message when a table writer was not ready in time; any other failure to open the table is a finding."""


def start(state: Path, sample_log: Path, complaints: Path, seed: int) -> int:
    """Return the process ID of a new learner, which leads a process group of its own."""
    process = os.fork()
    if process == 0:
        try:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            os.setpgid(0, 0)
            _learn(state, sample_log, random.Random(seed))  # noqa: S311 - no secret
        except BaseException:  # noqa: BLE001 - any error belongs in the report, and not in the callers of this copied stack
            complaints.write_text(traceback.format_exc(), encoding="utf-8")
        finally:
            os._exit(1)
    with contextlib.suppress(PermissionError, ProcessLookupError):  # parent or child, the first one does it
        os.setpgid(process, process)
    return process


def _learn(state: Path, sample_log: Path, chance: random.Random) -> NoReturn:
    """Record samples and poll, as the daemon does in its cycles."""
    writer, table, notices = _opened(state)
    if notices:
        raise AssertionError("; ".join(notices))
    written = SampleLogWriter(sample_log)
    sequence = table.sequence
    while True:
        sequence += 1
        sample = _sample(chance)
        written.write(sequence, sample)
        writer.record([sample])
        writer.poll()
        time.sleep(chance.uniform(0.0, _LONGEST_PAUSE_S))


def _opened(state: Path) -> tuple[TableWriterClient, StictionTable, tuple[str, ...]]:
    """Open the table; try again where the machine was too busy to start a table writer in time."""
    while True:
        try:
            return TableWriterClient.open(state, VALVE, WIDTH_M, timeout_s=LONG_S)
        except StateError as error:
            if TOO_BUSY not in str(error):
                raise


def _sample(chance: random.Random) -> LearnedSample:
    """Return a sample from any place of the travel, in all its digits."""
    quantity, direction = chance.choice(tuple(Quantity)), chance.choice(tuple(Direction))
    return LearnedSample(quantity, chance.uniform(0.0, _TRAVEL_M), direction, chance.uniform(*quantity.limits))


def children_of(process: int) -> list[int]:
    """Return the process IDs of the children of `process`: the only child of a learner is its table writer."""
    return [int(word) for word in Path(f"/proc/{process}/task/{process}/children").read_text("ascii").split()]


def is_running(process: int) -> bool:
    """Return whether the process is there, and no zombie."""
    try:
        text = Path(f"/proc/{process}/stat").read_text("ascii", errors="replace")
    except (FileNotFoundError, ProcessLookupError):
        return False
    return text.rpartition(")")[2].split()[0] not in {"Z", "X"}
