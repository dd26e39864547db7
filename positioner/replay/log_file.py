"""The file of a log, read so that nothing else is touched, nothing waits, and memory stays bounded. Shell.

A log may come from anybody, and python-can trusts it: it opens a database for writing, so that SQLite plays a journal
back that lies beside it, and it unpacks whatever a few bytes expand to. So its readers get a file here that is plain,
and whose lines and objects have bounded lengths; a database is read here.
"""

from __future__ import annotations

import gzip
import io
import os
import re
import sqlite3
import struct
import zlib
from typing import TYPE_CHECKING, Any, BinaryIO, Self, cast

from positioner.bus import can
from positioner.inputs.plain_file import open_plainly

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator
    from pathlib import Path
    from types import TracebackType

_TEXTS = {".asc": can.ASCReader, ".csv": can.CSVReader, ".log": can.CanutilsLogReader, ".trc": can.TRCReader}
_BLF, _DATABASE, _GZIP = ".blf", ".db", ".gz"
FORMATS = tuple(sorted((*_TEXTS, _BLF, _DATABASE)))
"""The ends of the names of logs that are read."""
_NOT_READ = {".mf4": "convert it to .blf or .asc"}
"""Formats of python-can that are not read here (`positioner.bus` says why), and what to do."""
_LONGEST_LINE = 1 << 16
"""Characters; a frame of CAN FD takes less than 400 in every format."""
_LARGEST_OBJECT = 4 << 20
"""Bytes of an object of BLF, unpacked; its containers hold 128 KiB."""
_LONGEST_WITHOUT_FRAME = 64 << 20
"""Unpacked bytes: what holds no frame for longer is no log of a bus, and would only take time."""
_LONGEST_FRAME = 64
_HIGHEST_IDENTIFIER = (1 << 29) - 1


class NotALogError(Exception):
    """A file that is none of the known logs; the message says why."""


class LogFile:
    """An open log: its frames as python-can gives them, and what is known about its end.

    promised: how many frames it says that it holds, None where it does not say. remark: what lies beside the file.
    """

    promised: int | None = None
    remark = ""

    def __init__(self, path: Path) -> None:
        """Open `path`.

        Raises:
            OSError: it cannot be opened, or is no regular file.
            NotALogError: it is not what the end of its name says, or nothing that is known.
        """
        kind = path.suffix.lower()
        packed = kind == _GZIP
        kind = path.with_suffix("").suffix.lower() if packed else kind
        self._length = _Length()
        self._lines: _Lines | None = None
        self._is_plain_text = kind in _TEXTS and not packed
        self._raw = self._taken = open_plainly(path)
        try:
            self._reader = self._reader_of(path, kind, packed=packed)
        except BaseException:
            self._close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file."""
        self._reader.stop()
        self._close()

    def __iter__(self) -> Iterator[can.Message]:
        """Yield the frames in order.

        Raises:
            Exception: something follows that cannot be read; python-can raises any of them for it.
        """
        for message in self._reader:
            self._length.begin()
            if len(message.data) > _LONGEST_FRAME:
                raise ValueError(f"a frame of {len(message.data)} bytes")
            if not 0 <= message.arbitration_id <= _HIGHEST_IDENTIFIER:
                raise ValueError(f"{message.arbitration_id} is no identifier")
            yield message

    @property
    def place(self) -> str:
        """The newest line of a text, for a message: `line 12: `; empty without lines."""
        return f"line {self._lines.number}: " if self._lines and self._lines.number else ""

    @property
    def ends_within_a_line(self) -> bool:
        """Whether a text ends without a line end: bytes of its last line may be missing."""
        if not self._is_plain_text:
            return False
        size = os.fstat(self._raw.fileno()).st_size
        return size > 0 and os.pread(self._raw.fileno(), 1, size - 1) != b"\n"

    def _close(self) -> None:
        self._taken.close()
        self._raw.close()

    def _reader_of(self, path: Path, kind: str, *, packed: bool) -> Any:
        if advice := _NOT_READ.get(kind):
            raise NotALogError(advice)
        if kind == _DATABASE and not packed:
            self.remark = _beside(path)
            return _Database(path, self._raw)
        # a reader closes its file at the end of it, and the last byte is looked at after that
        self._taken = os.fdopen(os.dup(self._raw.fileno()), "rb")
        file = cast("BinaryIO", gzip.GzipFile(fileobj=self._taken, mode="rb")) if packed else self._taken
        if kind in _TEXTS:
            self._lines = _Lines(file, self._length)
            return _TEXTS[kind](cast("Any", self._lines))
        if kind == _BLF:
            reader = _Blf(file, self._length)
            self.promised = reader.object_count
            return reader
        raise NotALogError(f"nobody knows the format {kind or 'of a name without one'!r}")


class _Length:
    """How many unpacked bytes have gone by since the last frame."""

    def __init__(self) -> None:
        self._bytes = 0

    def begin(self) -> None:
        self._bytes = 0

    def add(self, count: int) -> None:
        """Add bytes.

        Raises:
            ValueError: they are more than a log has between two frames.
        """
        self._bytes += count
        if self._bytes > _LONGEST_WITHOUT_FRAME:
            raise ValueError(f"no frame in {_LONGEST_WITHOUT_FRAME >> 20} MiB")


class _Lines:
    """The lines of a text log, counted, and none longer than a log has."""

    def __init__(self, file: BinaryIO, length: _Length) -> None:
        self._text = io.TextIOWrapper(file, encoding="locale")  # as python-can opens it
        self._length = length
        self.number = 0

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> str:
        self.number += 1
        line = self._text.readline(_LONGEST_LINE + 1)
        if not line:
            raise StopIteration
        if len(line) > _LONGEST_LINE:
            raise ValueError(f"longer than {_LONGEST_LINE >> 10} KiB")
        self._length.add(len(line))
        return line

    def close(self) -> None:
        self._text.close()


class _Blf(can.BLFReader):
    """BLF, object by object, each of a valid size and unpacked to no more than an object may have.

    python-can steps from object to object by their sizes, and would loop for ever at one of size 0.
    """

    _HEAD_BYTES, _SMALLEST_HEAD = 144, 72
    _BASE, _METHOD = struct.Struct("<4sHHLL"), struct.Struct("<H")
    _MAGIC, _CONTAINER, _CONTAINER_HEAD_BYTES, _PLAIN, _DEFLATED = b"LOBJ", 10, 16, 0, 2

    def __init__(self, file: BinaryIO, length: _Length) -> None:
        head = file.read(self._HEAD_BYTES)
        size = int.from_bytes(head[4:8], "little")
        if not head.startswith(b"LOGG") or len(head) < self._HEAD_BYTES:
            raise NotALogError("it is not a BLF file")
        if not self._SMALLEST_HEAD <= size <= _LONGEST_LINE:
            raise NotALogError(f"it is a damaged BLF file: a header of {size} bytes")
        file.seek(0)
        super().__init__(file)
        self._length = length

    def __iter__(self) -> Generator[can.Message, None, None]:
        while head := self.file.read(self._BASE.size):
            magic, _, _, size, kind = self._BASE.unpack(head)
            if magic != self._MAGIC:
                raise ValueError("no object where one must begin")
            self._check(size)
            content = self.file.read(size - self._BASE.size)
            self.file.read(size % 4)
            self._length.add(size + len(self._tail))
            if kind != self._CONTAINER:
                continue
            (method,) = self._METHOD.unpack_from(content)
            data = content[self._CONTAINER_HEAD_BYTES :]
            if method == self._DEFLATED:
                data = zlib.decompressobj().decompress(data, _LARGEST_OBJECT + 1)
                self._check(max(len(data), self._BASE.size))
                self._length.add(len(data))
            elif method != self._PLAIN:
                continue
            yield from self._parse_container(data)

    def _parse_data(self, data: bytes) -> Iterator[can.Message]:
        """Yield the frames of a container up to the first object without a valid size.

        Raises:
            ValueError: there is one.
        """
        at = data.find(self._MAGIC)
        while 0 <= at <= len(data) - self._BASE.size:
            size = int.from_bytes(data[at + 8 : at + 12], "little")
            if not self._BASE.size <= size <= _LARGEST_OBJECT:
                yield from super()._parse_data(data[:at])
                self._check(size)
            at = data.find(self._MAGIC, at + size)
        yield from super()._parse_data(data)

    def _check(self, size: int) -> None:
        if not self._BASE.size <= size <= _LARGEST_OBJECT:
            raise ValueError(f"an object of {size} bytes")


class _Database:
    """The database of python-can's writer: its one table, which is only read; SQLite opens no other file for it."""

    _MAGIC, _HEAD_BYTES, _LEAF = b"SQLite format 3\0", 108, b"\x0d"
    _ONE_TABLE = (1).to_bytes(2, "big")
    _COLUMNS = "ts real,arbitration_id integer,extended integer,remote integer,error integer,dlc integer,data blob"
    _READ = "SELECT rowid, ts, arbitration_id, extended, remote, error, data FROM messages ORDER BY rowid"
    _LONGEST_VALUE = 1 << 12
    _OTHER = "it holds other things than the one table of frames that python-can writes"

    def __init__(self, path: Path, file: BinaryIO) -> None:
        head = file.read(self._HEAD_BYTES)
        if not head.startswith(self._MAGIC) or len(head) < self._HEAD_BYTES:
            raise NotALogError("it is not an SQLite database")
        # the root of the schema, before SQLite reads it: a leaf with one row is one table at most
        if head[100:101] != self._LEAF or head[103:105] != self._ONE_TABLE:
            raise NotALogError(self._OTHER)
        # immutable: no lock, no journal, no write, whatever lies beside the file
        self._connection = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
        try:
            self._connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, self._LONGEST_VALUE)
            self._check_schema()
        except BaseException:
            self._connection.close()
            raise

    def _check_schema(self) -> None:
        rows = self._connection.execute("SELECT type, name, sql FROM sqlite_master").fetchall()
        if [_plain(row) for row in rows] != [("table", "messages", f"create table messages({self._COLUMNS})")]:
            raise NotALogError(self._OTHER)

    def __iter__(self) -> Iterator[can.Message]:
        before: int | None = None
        for row, time_s, identifier, extended, remote, error, data in self._connection.execute(self._READ):
            # a damaged tree may lead to the same rows again and again
            if before is not None and row <= before:
                raise ValueError("the rows are not in order")
            before = row
            if not (isinstance(time_s, int | float) and isinstance(identifier, int) and isinstance(data, bytes)):
                raise TypeError("a row that is no frame")
            yield can.Message(
                timestamp=float(time_s),
                arbitration_id=identifier,
                is_extended_id=bool(extended),
                is_remote_frame=bool(remote),
                is_error_frame=bool(error),
                data=data[: _LONGEST_FRAME + 1],
            )

    def stop(self) -> None:
        self._connection.close()


def _plain(row: tuple[Any, ...]) -> tuple[str, ...]:
    """Return a row of the schema without differences that mean nothing."""
    return tuple(re.sub(r"\s*([(),])\s*", r"\1", " ".join(str(each).lower().split())) for each in row)


def _beside(path: Path) -> str:
    """Return a remark where a journal of an unfinished write lies beside a database; it is not touched."""
    for end in ("-journal", "-wal"):
        journal = path.with_name(f"{path.name}{end}")
        try:
            if os.lstat(journal).st_size:
                return f"{journal.name} beside it is ignored: the newest frames may be missing"
        except OSError:
            continue
    return ""
