"""The sample log of a learner: each sample in all its digits, with its instant, in a file that survives a kill."""

from __future__ import annotations

import json
import os
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pydantic import TypeAdapter

from positioner.valve.stiction import LearnedSample

if TYPE_CHECKING:
    from pathlib import Path

_SAMPLE = TypeAdapter(LearnedSample)


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
        plain = _SAMPLE.dump_python(sample, mode="json")
        os.write(self._descriptor, json.dumps([time.monotonic_ns(), sequence, plain]).encode() + b"\n")


def read(path: Path) -> list[Entry]:
    """Return the entries, oldest first; a last line that a kill cut short is left out: the store did not receive it."""
    text = path.read_text("ascii") if path.exists() else ""
    return [_entry(line) for line in text.splitlines(keepends=True) if line.endswith("\n")]


def _entry(line: str) -> Entry:
    written_ns, sequence, plain = json.loads(line)
    return Entry(written_ns, sequence, _SAMPLE.validate_python(plain))
