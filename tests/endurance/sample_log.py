"""The sample log of whoever learns: what, in all its digits, and when, in a file that a kill cannot shorten."""

from __future__ import annotations

import json
import os
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.valve.stiction import Direction, LearnedSample, Quantity

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class Entry:
    """One lesson: the monotonic instant just before it was handed over, and what the table counts after it."""

    written_ns: int
    sequence: int
    sample: LearnedSample


class SampleLogWriter:
    """Appends one line a lesson with one system call: what was written survives the writer."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o640)

    def write(self, sequence: int, sample: LearnedSample) -> None:
        """Note that the sample is about to be handed over as the table's number `sequence`."""
        lesson = [sample.quantity, sample.position_m, sample.direction, sample.value]
        os.write(self._descriptor, json.dumps([time.monotonic_ns(), sequence, *lesson]).encode() + b"\n")


def read(path: Path) -> list[Entry]:
    """Return the entries, oldest first; a last one that a kill cut short was not handed over either."""
    text = path.read_text("ascii") if path.exists() else ""
    return [_entry(line) for line in text.splitlines(keepends=True) if line.endswith("\n")]


def _entry(line: str) -> Entry:
    written_ns, sequence, quantity, position_m, direction, value = json.loads(line)
    return Entry(written_ns, sequence, LearnedSample(Quantity(quantity), position_m, Direction(direction), value))
