"""A text file of a run: a disk that takes no more ends the file with one line of the log, never the loop. Shell."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, TextIO

from positioner.errors import UsageError
from positioner.machine.journal import Log, logger

if TYPE_CHECKING:
    from pathlib import Path

_BUFFER_BYTES = 1 << 16


class OutputFile:
    """The file, until it is closed or the disk takes no more; without a path there is none."""

    def __init__(self, name: str, path: Path | None, log: Log = logger) -> None:
        """Create `path`; `name` stands for it in messages, which go to `log`.

        Raises:
            UsageError: it cannot be written.
        """
        self._name, self._log = name, log
        try:
            self._file: TextIO | None = path.open("w", encoding="utf-8", buffering=_BUFFER_BYTES) if path else None
        except OSError as error:
            raise UsageError(f"{name} {path} cannot be written: {error.strerror}") from error

    @property
    def is_open(self) -> bool:
        """Whether anything is still written."""
        return self._file is not None

    def write(self, text: str) -> None:
        """Append `text`."""
        if self._file is None:
            return
        try:
            self._file.write(text)
        except OSError as error:
            self._log.error("the %s ends here: %s", self._name, error.strerror)
            with contextlib.suppress(OSError):
                self._file.close()
            self._file = None

    def close(self) -> None:
        """Write the text that is still buffered."""
        file, self._file = self._file, None
        try:
            if file:
                file.close()
        except OSError as error:
            self._log.error("the %s lacks its end: %s", self._name, error.strerror)
