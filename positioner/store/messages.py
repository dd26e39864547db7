"""What daemon, table writer and command line tell each other, one JSON line each."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from itertools import islice
from typing import TYPE_CHECKING, Any, TypeAlias

from positioner.errors import ConfigurationError, StateError
from positioner.store import document
from positioner.store.content import StoredTable
from positioner.store.document_reader import TableReader
from positioner.valve.stiction import Direction, LearnedSample, Quantity

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@dataclass(frozen=True, slots=True)
class Open:
    """Daemon → table writer, first: which table; `restarted` when it takes the place of a table writer that ended."""

    directory: str
    valve_id: str
    cell_width_m: float
    restarted: bool


@dataclass(frozen=True, slots=True)
class Opened:
    """Table writer → daemon: the table as it was found, and what was noteworthy about it."""

    stored: StoredTable
    notices: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Learn:
    """Daemon → table writer: samples, in the order in which they were recorded."""

    generation: int
    samples: tuple[LearnedSample, ...]


@dataclass(frozen=True, slots=True)
class Adopt:
    """Daemon → table writer: the whole table, in place of samples that could not be sent one by one."""

    stored: StoredTable


@dataclass(frozen=True, slots=True)
class Close:
    """Daemon → table writer: save, answer `Closed`, end."""


@dataclass(frozen=True, slots=True)
class Closed:
    """Table writer → daemon: everything is saved, or why it is not."""

    problem: str | None


@dataclass(frozen=True, slots=True)
class Saved:
    """Table writer → daemon: the table up to `sequence` is on the disk."""

    generation: int
    sequence: int


@dataclass(frozen=True, slots=True)
class Replaced:
    """Table writer → daemon: the table was replaced by command; `reason` says by which and where the former one is."""

    stored: StoredTable
    reason: str


@dataclass(frozen=True, slots=True)
class SavingFailed:
    """Table writer → daemon, once: the table cannot be saved; why, and what to do."""

    reason: str


@dataclass(frozen=True, slots=True)
class SavingWorks:
    """Table writer → daemon, once: the table could be saved again."""


@dataclass(frozen=True, slots=True)
class Notice:
    """Table writer → daemon: a line for the log."""

    text: str

    def __str__(self) -> str:
        """The line itself."""
        return self.text


@dataclass(frozen=True, slots=True)
class DumpRequest:
    """Command line → table writer: what is in the table?"""


@dataclass(frozen=True, slots=True)
class ResetRequest:
    """Command line → table writer: back the table up and empty it."""


@dataclass(frozen=True, slots=True)
class ImportRequest:
    """Command line → table writer: back the table up and replace it; `force` takes another valve's table too."""

    stored: StoredTable
    force: bool


@dataclass(frozen=True, slots=True)
class Dumped:
    """Table writer → command line: the table."""

    stored: StoredTable


@dataclass(frozen=True, slots=True)
class Done:
    """Table writer → command line: the table was replaced; `backup` holds the former one, if it held anything."""

    backup: str | None


@dataclass(frozen=True, slots=True)
class Refused:
    """Table writer → command line: nothing was changed, and why."""

    reason: str


@dataclass(frozen=True, slots=True)
class Rejected:
    """Owner's process → root's: the file is no table; its `name` in the directory, the fault and the detail."""

    name: str
    fault: str
    detail: str


ToWriter: TypeAlias = Open | Learn | Adopt | Close
FromWriter: TypeAlias = Opened | Closed | Saved | Replaced | SavingFailed | SavingWorks | Notice
Request: TypeAlias = DumpRequest | ResetRequest | ImportRequest
Answer: TypeAlias = Dumped | Done | Refused | Rejected
Message: TypeAlias = ToWriter | FromWriter | Request | Answer

_CELLS = "Cells"
_KINDS: dict[str, Callable[..., Message]] = {kind.__name__: kind for kind in Message.__args__}


CELLS_PER_LINE = 16
"""So many cells are read or written in well under a millisecond: a control cycle can wait for one line."""


def lines(message: Message) -> Iterator[bytes]:
    """Yield the message line by line: a table's cells come before it, a few in each line."""
    plain = {field.name: _plain(getattr(message, field.name)) for field in fields(message)}
    if table := plain.get("stored"):
        cells = iter(table["cells"])
        while part := list(islice(cells, CELLS_PER_LINE)):
            yield json.dumps({"kind": _CELLS, "cells": [document.plain_cell(*one) for one in part]}).encode()
        table["cells"] = []
    yield json.dumps({"kind": type(message).__name__, **plain}).encode()


def encode(message: Message) -> bytes:
    """Return all lines of the message, the last one without its end."""
    return b"\n".join(lines(message))


class Decoder:
    """Puts messages together from lines; one for each connection."""

    def __init__(self) -> None:
        """Begin with nothing read."""
        self._reader = TableReader("message")

    def feed(self, line: bytes) -> Message | None:
        """Return the message that the line completes, or None.

        Raises:
            StateError: the line is no message.
        """
        reader = self._reader
        try:
            plain = json.loads(line)
            kind = plain.pop("kind")
            if kind == _CELLS:
                reader.take(plain.pop("cells"))
                return None
            self._reader = TableReader("message")
            return _KINDS[kind](**{name: _typed(name, value, reader) for name, value in plain.items()})
        except (ValueError, TypeError, AttributeError, KeyError, RecursionError, ConfigurationError) as error:
            self._reader = TableReader("message")
            told = f": {error}" if isinstance(error, ConfigurationError) else ""
            raise StateError(f"not a message: {line[:80]!r}{told}") from error


def decode(data: bytes) -> Message:
    """Return the one message in the lines of `data`.

    Raises:
        StateError: they are none.
    """
    decoder = Decoder()
    found = [message for line in data.split(b"\n") if line and (message := decoder.feed(line)) is not None]
    if len(found) != 1:
        raise StateError(f"not a message: {data[:80]!r}")
    return found[0]


def _plain(value: object) -> Any:
    if isinstance(value, StoredTable):
        return {**document.head(value), "cells": document.cells_of(value)}
    if isinstance(value, LearnedSample):
        return [value.quantity, value.position_m, value.direction, value.value]
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return value


def _typed(name: str, value: Any, reader: TableReader) -> Any:
    if name == "stored":
        return reader.finish(value)
    if name == "samples":
        return tuple(LearnedSample(Quantity(q), float(x), Direction(d), float(y)) for q, x, d, y in value)
    return tuple(value) if isinstance(value, list) else value
