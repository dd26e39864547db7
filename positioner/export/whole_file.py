"""A file that appears complete or not at all: it is written beside its place, and then renamed. Shell."""

from __future__ import annotations

import os
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from positioner.errors import StateError

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a path to write to; at the end of the `with` block that file takes the place of `path`.

    It lies in a new folder beside `path`, of a name that nobody knows before, which only this user may enter: no link
    waits there for a writer. A link at `path` is replaced, and not written through. After an exception nothing of it
    is left, and what stood at `path` still does.

    Raises:
        StateError: it cannot be written.
    """
    try:
        with TemporaryDirectory(prefix=".export-", dir=path.absolute().parent, ignore_cleanup_errors=True) as folder:
            part = Path(folder) / path.name
            yield part
            with part.open("rb") as file:
                os.fsync(file.fileno())
            part.replace(path)
    except OSError as error:
        raise StateError(f"{path}: cannot be written: {error.strerror or error}") from error
