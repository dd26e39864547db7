"""The sample log of a learner: each sample in all its digits, with its instant, in a file that survives a kill."""

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
    """One sample, the monotonic instant just before the store receives it, and its number in the table."""

    written_ns: int
    sequence: int
    sample: LearnedSample


class SampleLogWriter:
    """Appends one line for each sample with one system call: a written line survives a kill."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o640)

    def write(self, sequence: int, sample: LearnedSample) -> None:
        """Write the sample that the store receives next, as number `sequence` of the table."""
        fields = [sample.quantity, sample.position_m, sample.direction, sample.value]
        os.write(self._descriptor, json.dumps([time.monotonic_ns(), sequence, *fields]).encode() + b"\n")


def read(path: Path) -> list[Entry]:
    """Return the entries, oldest first; a last line that a kill cut short is left out: the store did not receive it."""
    text = path.read_text("ascii") if path.exists() else ""
    return [_entry(line) for line in text.splitlines(keepends=True) if line.endswith("\n")]


def _entry(line: str) -> Entry:
    written_ns, sequence, quantity, position_m, direction, value = json.loads(line)
    return Entry(written_ns, sequence, LearnedSample(Quantity(quantity), position_m, Direction(direction), value))
