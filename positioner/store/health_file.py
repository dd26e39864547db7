"""The health of a valve as files in its state directory, written in one step each; its user holds the directory's lock.

health.json            the newest document
health.new.json        the next one, until it takes the place of the newest
health.previous.json   the one before, used where the newest is damaged
health.<reason>-<UTC time>-<n>.json   files that were found and not used: moved aside, never deleted
"""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from positioner.errors import StateError
from positioner.machine import kept_files
from positioner.store.document import utc_text
from positioner.store.health_document import HealthDocument, from_plain, to_plain
from positioner.store.table_directory import BACKUPS

if TYPE_CHECKING:
    from contextlib import AbstractContextManager
    from pathlib import Path

HEALTH, PREVIOUS = "health.json", "health.previous.json"
_NEW = "health.new.json"
_IN_ORDER = (HEALTH, _NEW, PREVIOUS)
"""Between two renames of a save there is no newest file."""
FAILED = (OSError, ValueError)
"""What a save raises; the file is then as before, and the save may be tried again."""


class HealthFile:
    """The files of one valve; `take_notices` has lines about files that were not used."""

    def __init__(self, directory: Path, valve_id: str) -> None:
        self._directory = directory
        self._valve_id = valve_id
        self._inode: int | None = None
        self._aside: list[tuple[str, str]] = []
        self._notices: list[str] = []

    def load(self) -> HealthDocument:
        """Return the newest document that can be used, else a new one that starts now; nothing is written."""
        with _opened(self._directory) as folder:
            take = partial(self._taken, folder)
            found = next(kept_files.used(folder, _IN_ORDER, take, self._reject), None)
        if found is None:
            if self._aside:
                self._notices.append("the counters of this valve start anew")
            return HealthDocument(self._valve_id, utc_text(int(time.time())))
        if self._aside:
            self._notices.append(f"using the health of {found.saved}: what was counted since then is lost")
        return found

    def save(self, document: HealthDocument) -> HealthDocument:
        """Put the document in the place of the newest one, and return it with its date."""
        saved = replace(document, saved=utc_text(int(time.time())))
        content = to_plain(saved)
        self._clear_the_place()
        with _opened(self._directory) as folder:
            kept_files.write(folder, _NEW, content)
            with suppress(FileNotFoundError):
                os.rename(HEALTH, PREVIOUS, src_dir_fd=folder, dst_dir_fd=folder)
            os.rename(_NEW, HEALTH, src_dir_fd=folder, dst_dir_fd=folder)
            os.fsync(folder)
            self._inode = os.stat(HEALTH, dir_fd=folder, follow_symlinks=False).st_ino
        return saved

    def back_up(self, document: HealthDocument) -> Path:
        """Return the path of a new backup of the document."""
        place = self._directory / BACKUPS
        place.mkdir(exist_ok=True)
        path = kept_files.unused_name(place, "before-health-reset", ".json")
        with _opened(place) as folder:
            kept_files.write(folder, path.name, to_plain(document))
        return path

    def take_notices(self) -> tuple[str, ...]:
        """Return the notices since the last call, a line each."""
        notices, self._notices = tuple(self._notices), []
        return notices

    def _taken(self, folder: int, name: str, plain: dict[str, Any]) -> HealthDocument:
        document = from_plain(plain)
        if document.valve_id != self._valve_id:
            raise ValueError(f"belongs to valve {document.valve_id!r}, this is {self._valve_id!r}")
        if name == HEALTH:
            self._inode = os.stat(name, dir_fd=folder, follow_symlinks=False).st_ino
        return document

    def _reject(self, name: str, error: Exception) -> None:
        self._aside.append((name, kept_files.DAMAGED))
        self._notices.append(f"{self._directory / name} {kept_files.why(error)}")

    def _clear_the_place(self) -> None:
        """Move files aside that are not ours: those that were not used, and one that somebody has put there since."""
        with suppress(FileNotFoundError):
            newest = os.lstat(self._directory / HEALTH).st_ino
            if newest != self._inode and (HEALTH, kept_files.DAMAGED) not in self._aside:
                self._aside.append((HEALTH, "unexpected"))
        while self._aside:
            name, fault = self._aside[-1]
            moved = kept_files.set_aside(self._directory, name, fault)
            self._notices += [f"{before}: not used, moved aside to {after}" for before, after in moved]
            self._aside.pop()


def read(directory: Path) -> HealthDocument:
    """Return the health in a state directory, which need only be readable.

    Raises:
        StateError: there is none, or it cannot be read.
    """
    wrong: list[str] = []
    try:
        with _opened(directory) as folder:
            taken = kept_files.used(
                folder,
                _IN_ORDER,
                lambda _, plain: from_plain(plain),
                lambda name, error: wrong.append(f"{directory / name} {kept_files.why(error)}"),
            )
            found = next(taken, None)
    except OSError as error:
        raise StateError(f"{directory}: cannot be read: {error.strerror}") from error
    if found is None:
        raise StateError(
            wrong[0] if wrong else f"{directory}: holds no health of a valve yet: a running daemon writes it"
        )
    return found


def _opened(directory: Path) -> AbstractContextManager[int]:
    return kept_files.opened(directory, ".")
