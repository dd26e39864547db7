"""The frames of a recorded bus: candump, ASC, BLF, CSV, or another format that python-can reads. Shell.

The frames stay in the file, and each pass reads them again: a log may be larger than the memory.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from itertools import count, islice
from typing import TYPE_CHECKING, Any, Self

from tqdm import tqdm

from positioner.bus import can
from positioner.errors import ExitCode, PositionerError, shortened
from positioner.wire.messages import CanFrame

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

_NS = 1_000_000_000
_BLF_HEADER_BYTES = 144
_BLF_OBJECT, _BLF_OBJECT_BYTES = b"LOBJ", 16
"""The first bytes of every object, and the length of its header, in which bytes 8 to 11 are the object's size."""
_NOT_READ = {".mf4": "convert it to .blf or .asc"}
"""Formats of python-can that are not read here (`positioner.bus` says why), and what to do."""
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

    def frames(self) -> Iterator[LogFrame]:
        """Yield the frames in order, read from the file again.

        Raises:
            LogError: the file has changed.
        """
        found = 0
        for frame in islice(_Pass(self.path), self.count):
            found = frame.number
            yield frame
        if found < self.count:
            raise LogError(f"{self.path}: changed while it was read: of {self.count} frames it holds {found} now")

    def instant_s(self, frame: LogFrame) -> float:
        """Return the time stamp that `frame` has in the file, in s."""
        return self.begin_s + frame.time_ns / _NS


def read_log(path: Path, show: Callable[[LogFrame], None] = lambda _: None) -> BusLog:
    """Return the log in `path` after one pass, which gives each frame to `show`; of a damaged log, the readable part.

    Raises:
        LogError: it cannot be read at all, or holds no frame.
    """
    read, last = _Pass(path), None
    for last in tqdm(read, "reading", unit=" frames", delay=1.0, leave=False, disable=None):
        show(last)
    if last is None:
        raise LogError(f"{path}: holds no frame{f': {read.cut}' if read.cut else ''}; known formats: {_formats()}")
    return BusLog(path, last.number, read.begin_s, read.begin_s + last.time_ns / _NS, read.cut, read.is_damaged)


class _Pass:
    """One pass over a file: its frames, and after the last one why no further frame can be read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.begin_s = 0.0
        self.cut = ""
        self.is_damaged = False

    def __iter__(self) -> Iterator[LogFrame]:
        read, last = 0, None
        with _opened(self.path) as reader:
            lines = _Lines.of(reader)
            messages: Iterator[can.Message] = iter(reader)
            for number in count(1):
                try:
                    message = next(messages, None)
                    _check_stamp(message)
                except Exception as error:  # noqa: BLE001 - a damaged file makes python-can raise any of them
                    why = f"{type(error).__name__}: {shortened(str(error))}"
                    self.cut = f"{lines.place}the part after frame {read} cannot be read ({why})"
                    self.is_damaged = True
                    break
                if message is None:
                    break
                if last:
                    yield last
                self.begin_s = self.begin_s if last else message.timestamp
                # to the microsecond: stamps that are large floating-point numbers carry no more
                time_ns = round((message.timestamp - self.begin_s) * 1e6) * 1000
                read, last = number, LogFrame(number, time_ns, _frame(message), sent=not message.is_rx)
            promised = getattr(reader, "object_count", read)
        if not self.cut and _ends_within_a_line(self.path):
            self.cut = f"the line after frame {max(0, read - 1)} is not complete"
            return
        if not self.cut and promised > read:
            self.cut = f"frame {read} is the last of {promised}"
        if last:
            yield last


class _Lines:
    """The file of a text log, whose lines are counted while a reader of python-can takes them."""

    def __init__(self, file: Any) -> None:
        self._file = file
        self._number = 0

    @classmethod
    def of(cls, reader: can.io.generic.MessageReader) -> Self:
        """Return the lines of this reader; of a binary log, none."""
        file = getattr(reader, "file", None)
        lines = cls(file)
        if isinstance(file, io.TextIOBase):
            reader.file = lines  # type: ignore[attr-defined]
        return lines

    @property
    def place(self) -> str:
        """The newest line, for a message: `line 12: `; empty without lines."""
        return f"line {self._number}: " if self._number else ""

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> str:
        self._number += 1
        return next(self._file)  # type: ignore[no-any-return]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def _opened(path: Path) -> can.io.generic.MessageReader:
    if advice := _NOT_READ.get(path.suffix.lower()):
        raise LogError(f"{path}: cannot be read: {advice}; known formats: {_formats()}")
    try:
        with path.open("rb") as file:  # python-can's own message would name neither the file nor the reason
            _check_head(path, file.read(_BLF_HEADER_BYTES))
        return _finite(can.LogReader(path))
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    except LogError:
        raise
    except Exception as error:
        text = shortened(str(error)) or type(error).__name__
        raise LogError(f"{path}: cannot be read: {text}; known formats: {_formats()}") from error


def _check_head(path: Path, head: bytes) -> None:
    """Refuse a file whose name ends in .blf but whose content is not BLF: python-can would not close it."""
    if path.suffix.lower() == ".blf" and not (head.startswith(b"LOGG") and len(head) == _BLF_HEADER_BYTES):
        raise LogError(f"{path}: cannot be read: it is not a BLF file")


def _finite(reader: can.io.generic.MessageReader) -> can.io.generic.MessageReader:
    """Return the reader; a reader of BLF gets only objects that have a valid size."""
    if isinstance(reader, can.BLFReader):
        parse = reader._parse_data  # noqa: SLF001 - a damaged size would make it loop for ever
        reader._parse_data = lambda data: parse(_advancing(data))  # type: ignore[method-assign]  # noqa: SLF001
    return reader


def _advancing(data: bytes) -> bytes:
    """Return a part of a BLF file up to the first object that is smaller than its own header.

    python-can steps from object to object by their sizes, and loops for ever at one of size 0.
    """
    at = data.find(_BLF_OBJECT)
    while 0 <= at <= len(data) - _BLF_OBJECT_BYTES:
        size = int.from_bytes(data[at + 8 : at + 12], "little")
        if size < _BLF_OBJECT_BYTES:
            return data[:at]
        at = data.find(_BLF_OBJECT, at + size)
    return data


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


def _ends_within_a_line(path: Path) -> bool:
    """Return whether a text log ends without a line end: bytes of its last line may be missing."""
    if path.suffix.lower() not in {".log", ".asc", ".csv", ".trc"}:
        return False
    with path.open("rb") as file:
        if file.seek(0, 2) == 0:
            return False
        file.seek(-1, 2)
        return file.read(1) != b"\n"


def _formats() -> str:
    return ", ".join(sorted(can.io.player.MESSAGE_READERS.keys() - _NOT_READ.keys()))
