"""The journal of a study: one line for each outcome, on the disk before the next one is waited for. Shell.

A process that is killed leaves a journal that ends at any byte. The next one cuts off a line that has no end, and plays
again what no whole line holds. An outcome counts as long as the code of its run is the same.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, BinaryIO, Generic, Self, TypeVar

from positioner.errors import writing

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from _typeshed import DataclassInstance

Result = TypeVar("Result", bound="DataclassInstance")


class Journal(Generic[Result]):
    """The outcomes of the runs that were played, in the file `path`; a context manager.

    An outcome is a dataclass; `outcome_of` makes it of its fields as JSON has them. Where that raises a ValueError, a
    KeyError or a TypeError, the line is damaged, or of another version, and its run is played again.
    """

    def __init__(self, path: Path, outcome_of: Callable[[dict[str, Any]], Result]) -> None:
        self._path, self._outcome_of = path, outcome_of
        with writing(path):
            self._file: BinaryIO = path.open("a+b")
            self._file.seek(0)
            content = self._file.read()
            whole = content.rfind(b"\n") + 1
            self._file.truncate(whole)
        self._known: dict[tuple[str, str], Result] = {}
        for line in content[:whole].splitlines():
            self._read(line)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def outcome(self, key: str, code: str) -> Result | None:
        """Return the outcome of the run with this key, played by this code; None where there is none."""
        return self._known.get((key, code))

    def add(self, key: str, code: str, outcome: Result) -> None:
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
            key, code = kept.pop("run"), kept.pop("code")
            self._known[key, code] = self._outcome_of(kept)
        except (ValueError, KeyError, TypeError, AttributeError):
            return
