"""The frames of a recorded bus: candump, ASC, BLF, CSV, or another format that python-can reads. Shell.

The frames stay in the file, and each pass reads them again: a log may be larger than the memory.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path
from typing import TYPE_CHECKING

from tqdm import tqdm

from positioner.errors import ExitCode, PositionerError, shortened
from positioner.inputs.plain_file import MOST_MIB
from positioner.replay.log_file import FORMATS, LogFile, NotALogError
from positioner.wire.messages import CanFrame

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from positioner.bus import can

_NS = 1_000_000_000
_LOOKS_EVERY = 1 << 12
"""Frames between two looks at the memory: a frame takes less than 1 KiB wherever it is kept."""
_MEMORY = Path("/proc/self/statm")
_LATEST_S = 1e11
"""A later time stamp is invalid: it would be after the year 5000."""


class LogError(PositionerError):
    """A log that cannot be replayed: it cannot be read, or frames that a replay needs are missing."""

    exit_code = ExitCode.IO


@dataclass(frozen=True, slots=True)
class LogFrame:
    """One frame of a log: its number (from 1), its time in ns since the first frame, and whether the logger sent it."""

    number: int
    time_ns: int
    frame: CanFrame
    sent: bool


@dataclass(frozen=True, slots=True)
class BusLog:
    """A log: its number of frames, the time stamps of the first and the last in s, and why it ends early, if so.

    `is_damaged`: something follows that cannot be read. Otherwise a log that ends early was cut off.
    """

    path: Path
    count: int
    begin_s: float
    end_s: float
    cut: str = ""
    is_damaged: bool = False
    most_mib: int = MOST_MIB

    def frames(self) -> Iterator[LogFrame]:
        """Yield the frames in order, read from the file again.

        Raises:
            LogError: the file has changed, or what is done with the frames takes more memory than `most_mib`.
        """
        found = 0
        for frame in islice(_Pass(self.path, self.most_mib), self.count):
            found = frame.number
            yield frame
        if found < self.count:
            raise LogError(f"{self.path}: changed while it was read: of {self.count} frames it holds {found} now")

    def instant_s(self, frame: LogFrame) -> float:
        """Return the time stamp that `frame` has in the file, in s."""
        return self.begin_s + frame.time_ns / _NS


def read_log(path: Path, show: Callable[[LogFrame], None] = lambda _: None, most_mib: int = MOST_MIB) -> BusLog:
    """Return the log in `path` after one pass, which gives each frame to `show`; of a damaged log, the readable part.

    Nothing but the file is opened, and that only for reading. most_mib: memory in MiB that a pass may take.

    Raises:
        LogError: it cannot be read at all, holds no frame, or takes more memory.
    """
    read, last = _Pass(path, most_mib), None
    for last in tqdm(read, "reading", unit=" frames", delay=1.0, leave=False, disable=None):
        show(last)
    if last is None:
        raise LogError(f"{path}: holds no frame{f': {read.cut}' if read.cut else ''}; known formats: {_formats()}")
    end_s = read.begin_s + last.time_ns / _NS
    return BusLog(path, last.number, read.begin_s, end_s, read.cut, read.is_damaged, most_mib)


class _Pass:
    """One pass over a file: its frames, and after the last one why no further frame can be read."""

    def __init__(self, path: Path, most_mib: int) -> None:
        self.path = path
        self.begin_s = 0.0
        self.cut = ""
        self.is_damaged = False
        self._most_mib = most_mib

    def __iter__(self) -> Iterator[LogFrame]:
        read, last = 0, None
        begin_mib = _memory_mib()
        with _opened(self.path) as file:
            messages = iter(file)
            for number in count(1):
                try:
                    message = next(messages, None)
                    _check_stamp(message)
                except Exception as error:  # noqa: BLE001 - a damaged file makes python-can raise any of them
                    why = f"{type(error).__name__}: {shortened(str(error))}"
                    self.cut = f"{file.place}the part after frame {read} cannot be read ({why})"
                    self.is_damaged = True
                    break
                if message is None:
                    break
                if number % _LOOKS_EVERY == 0 and _memory_mib() - begin_mib > self._most_mib:
                    raise LogError(self._too_large(read))
                if last:
                    yield last
                self.begin_s = self.begin_s if last else message.timestamp
                # to the microsecond: stamps that are large floating-point numbers carry no more
                time_ns = round((message.timestamp - self.begin_s) * 1e6) * 1000
                read, last = number, LogFrame(number, time_ns, _frame(message), sent=not message.is_rx)
            promised, is_within_a_line = file.promised, file.ends_within_a_line
        if not self.cut and is_within_a_line:
            self.cut = f"the line after frame {max(0, read - 1)} is not complete"
            return
        if not self.cut and promised is not None and promised > read:
            self.cut = f"frame {read} is the last of {promised}"
        self.cut = self.cut or file.remark
        if last:
            yield last

    def _too_large(self, read: int) -> str:
        text = f"its first {read} frames take more than {self._most_mib} MiB of memory"
        return f"{self.path}: {text}: give a part of it, or allow more by --max-size, such as {4 * self._most_mib}"


def _opened(path: Path) -> LogFile:
    try:
        return LogFile(path)
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    except Exception as error:
        text = (
            shortened(str(error))
            if isinstance(error, NotALogError)
            else f"{type(error).__name__}: {shortened(str(error))}"
        )
        raise LogError(f"{path}: cannot be read: {text}; known formats: {_formats()}") from error


def _memory_mib() -> float:
    """Return the memory of this process that is in use, in MiB; 0 where the system does not tell."""
    try:
        pages = int(_MEMORY.read_bytes().split()[1])
    except (OSError, ValueError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def _check_stamp(message: can.Message | None) -> None:
    if message is not None and not abs(message.timestamp) <= _LATEST_S:
        raise ValueError(f"{message.timestamp:g} s is no time stamp")


def _frame(message: can.Message) -> CanFrame:
    return CanFrame(
        message.arbitration_id,
        bytes(message.data),
        message.is_extended_id,
        message.is_error_frame,
        message.is_remote_frame,
    )


def _formats() -> str:
    return ", ".join(FORMATS)
