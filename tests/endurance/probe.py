"""The delays of the disk itself: a process that repeats and times the disk operations of a commit."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

_PAUSE_S = 0.02
_PAGE = bytes(4096)


class DiskProbe:
    """Creates, syncs and renames a file in a folder, over and over; `longest_s` is the longest of the `rounds`."""

    def __init__(self, folder: Path) -> None:
        context = multiprocessing.get_context("fork")
        self._rounds = context.Value("Q", 0, lock=False)
        self._longest = context.Value("d", 0.0, lock=False)
        self._late = context.Value("d", 0.0, lock=False)
        self._process = context.Process(target=self._run, args=(folder,), daemon=True)

    def __enter__(self) -> Self:
        self._process.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.join()

    @property
    def rounds(self) -> int:
        return int(self._rounds.value)

    @property
    def longest_s(self) -> float:
        return float(self._longest.value)

    @property
    def latest_s(self) -> float:
        """The longest time by which the probe itself woke up too late: this is the delay by a busy processor."""
        return float(self._late.value)

    def _run(self, folder: Path) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        fresh, place = folder / "probe.new", folder / "probe"
        while True:
            started_s = time.monotonic()
            one_round(folder, fresh, place)
            ended_s = time.monotonic()
            self._longest.value = max(self._longest.value, ended_s - started_s)
            self._rounds.value += 1
            time.sleep(_PAUSE_S)
            self._late.value = max(self._late.value, time.monotonic() - ended_s - _PAUSE_S)


def one_round(folder: Path, fresh: Path, place: Path) -> None:
    """Create a file, sync it, put it in place and sync the folder."""
    descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o640)
    try:
        os.write(descriptor, _PAGE)
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
    fresh.replace(place)
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
