"""The journal of a campaign: one line for each outcome, on the disk before the next one is waited for. Shell.

A process that is killed leaves a journal that ends at any byte. The next one cuts off a line that has no end, and plays
again what no whole line holds. An outcome counts as long as the code of its run is the same.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from typing import TYPE_CHECKING, BinaryIO, Self

from positioner.campaign.run import Figures, Outcome
from positioner.errors import writing

if TYPE_CHECKING:
    from pathlib import Path


class Journal:
    """The outcomes of the runs that were played, in the file `path`; a context manager."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with writing(path):
            self._file: BinaryIO = path.open("a+b")
            self._file.seek(0)
            content = self._file.read()
            whole = content.rfind(b"\n") + 1
            self._file.truncate(whole)
        self._known: dict[tuple[str, str], Outcome] = {}
        for line in content[:whole].splitlines():
            self._read(line)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def outcome(self, key: str, code: str) -> Outcome | None:
        """Return the outcome of the run with this key, played by this code; None where there is none."""
        return self._known.get((key, code))

    def add(self, key: str, code: str, outcome: Outcome) -> None:
        """Keep the outcome of a run.

        Raises:
            StateError: the disk refuses.
        """
        line = json.dumps({"run": key, "code": code, **asdict(outcome)})
        with writing(self._path):
            self._file.write(line.encode() + b"\n")
            self._file.flush()
            os.fsync(self._file.fileno())

    def _read(self, line: bytes) -> None:
        try:
            kept = json.loads(line)
            figures = None if kept["figures"] is None else Figures(**kept["figures"])
            self._known[kept["run"], kept["code"]] = Outcome(figures, kept["failure"])
        except (ValueError, KeyError, TypeError):
            return  # damaged, or of a version with other figures: the run is played again
