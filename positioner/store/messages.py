"""The messages between daemon, table writer and command line: a JSON line each, a table's cells in lines before it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from pydantic import PlainSerializer, PlainValidator, TypeAdapter, ValidationInfo

from positioner.errors import ConfigurationError, StateError
from positioner.inputs.table import SettingsTable
from positioner.store import document
from positioner.store.content import StoredTable
from positioner.store.health_messages import (
    NO_HEALTH,
    HealthDumped,
    HealthReplaced,
    HealthRequest,
    HealthResetRequest,
    KeepHealth,
)
from positioner.valve.stiction import MOST_CELLS, LearnedSample

if TYPE_CHECKING:
    from collections.abc import Iterator


def _stored(plain: Any, info: ValidationInfo) -> StoredTable:
    return document.from_plain(plain, "message", info.context or ())


Stored: TypeAlias = Annotated[
    StoredTable, PlainValidator(_stored), PlainSerializer(lambda stored: {**document.head(stored), "cells": []})
]
"""A table in a message: without its cells, which come in lines before it."""


@dataclass(frozen=True, slots=True)
class Open(SettingsTable):
    """Daemon → table writer, first: which table; `restarted` when it takes the place of a table writer that ended."""

    directory: str
    valve_id: str
    cell_width_m: float
    restarted: bool


@dataclass(frozen=True, slots=True)
class Opened(SettingsTable):
    """Table writer → daemon: the table that was found, notices about it, and the health of the valve."""

    stored: Stored
    notices: tuple[str, ...]
    health: HealthReplaced = NO_HEALTH


@dataclass(frozen=True, slots=True)
class Learn(SettingsTable):
    """Daemon → table writer: samples, in the order in which they were recorded."""

    generation: int
    samples: tuple[LearnedSample, ...]


@dataclass(frozen=True, slots=True)
class Adopt(SettingsTable):
    """Daemon → table writer: the whole table, in place of samples that could not be sent one by one."""

    stored: Stored


@dataclass(frozen=True, slots=True)
class Close(SettingsTable):
    """Daemon → table writer: save, answer `Closed`, end."""


@dataclass(frozen=True, slots=True)
class Closed(SettingsTable):
    """Table writer → daemon: everything is saved, or why it is not."""

    problem: str | None


@dataclass(frozen=True, slots=True)
class Saved(SettingsTable):
    """Table writer → daemon: the table up to `sequence` is on the disk."""

    generation: int
    sequence: int


@dataclass(frozen=True, slots=True)
class Replaced(SettingsTable):
    """Table writer → daemon: the table was replaced by command; `reason` says by which and where the former one is."""

    stored: Stored
    reason: str


@dataclass(frozen=True, slots=True)
class SavingFailed(SettingsTable):
    """Table writer → daemon, after each failed attempt: why the table cannot be saved, and what to do."""

    reason: str


@dataclass(frozen=True, slots=True)
class SavingWorks(SettingsTable):
    """Table writer → daemon, once: the table could be saved again."""


@dataclass(frozen=True, slots=True)
class Notice(SettingsTable):
    """Table writer → daemon: a line for the log."""

    text: str


@dataclass(frozen=True, slots=True)
class DumpRequest(SettingsTable):
    """Command line → table writer: send me the table."""


@dataclass(frozen=True, slots=True)
class ResetRequest(SettingsTable):
    """Command line → table writer: back the table up and empty it."""


@dataclass(frozen=True, slots=True)
class ImportRequest(SettingsTable):
    """Command line → table writer: back the table up and replace it; `force` takes another valve's table too."""

    stored: Stored
    force: bool


@dataclass(frozen=True, slots=True)
class Dumped(SettingsTable):
    """Table writer → command line: the table."""

    stored: Stored


@dataclass(frozen=True, slots=True)
class Done(SettingsTable):
    """Table writer → command line: the table was replaced; `backup` holds the former one, if it held anything."""

    backup: str | None


@dataclass(frozen=True, slots=True)
class Refused(SettingsTable):
    """Table writer → command line: nothing was changed, and why."""

    reason: str


@dataclass(frozen=True, slots=True)
class Rejected(SettingsTable):
    """Owner's process → root's: the file is no table; its `name` in the directory, the fault and the detail."""

    name: str
    fault: str
    detail: str


@dataclass(frozen=True, slots=True)
class Unreadable(SettingsTable):
    """Stands for a received line that is no message, and says why; it is never sent."""

    reason: str


FromWriter: TypeAlias = Opened | Closed | Saved | Replaced | HealthReplaced | SavingFailed | SavingWorks | Notice
Request: TypeAlias = DumpRequest | ResetRequest | ImportRequest | HealthRequest | HealthResetRequest
Answer: TypeAlias = Dumped | HealthDumped | Done | Refused | Rejected
Message: TypeAlias = Open | Learn | Adopt | KeepHealth | Close | FromWriter | Request | Answer | Unreadable

_ADAPTERS: dict[str, TypeAdapter[Message]] = {kind.__name__: TypeAdapter(kind) for kind in Message.__args__}
_CELLS = "Cells"
CELLS_PER_LINE = 16
"""So many cells are read or written in well under a millisecond: a control cycle can wait for one line."""


def lines(message: Message) -> Iterator[bytes]:
    """Yield the message line by line: a table's cells come before it, a few in each line."""
    if stored := getattr(message, "stored", None):
        cells = document.cells(stored)
        while part := list(islice(cells, CELLS_PER_LINE)):
            yield json.dumps({"kind": _CELLS, "cells": part}).encode()
    kind = type(message).__name__
    yield json.dumps({"kind": kind, **_ADAPTERS[kind].dump_python(message)}).encode()


def encode(message: Message) -> bytes:
    """Return all lines of the message, the last one without its end."""
    return b"\n".join(lines(message))


class Decoder:
    """Puts messages together from lines; one for each connection."""

    def __init__(self) -> None:
        self._cells: list[document.PlainCell] = []

    def feed(self, line: bytes) -> Message | None:
        """Return the message that the line completes, or None.

        Raises:
            StateError: the line is no message.
        """
        cells, self._cells = self._cells, []
        try:
            plain = json.loads(line)
            kind = plain.pop("kind")
            if kind != _CELLS:
                return _ADAPTERS[kind].validate_python(plain, context=cells)
            cells.extend(document.cells_from(plain["cells"], "message"))
        except (ValueError, TypeError, AttributeError, KeyError, RecursionError, ConfigurationError) as error:
            problem = f": {error}" if isinstance(error, ConfigurationError) else ""
            raise StateError(f"not a message: {line[:80]!r}{problem}") from error
        self._cells = cells[: MOST_CELLS + 1]
        return None


def decode(data: bytes) -> Message:
    """Return the one message in the lines of `data`.

    Raises:
        StateError: they are not one message.
    """
    decoder = Decoder()
    found = [message for line in data.split(b"\n") if line and (message := decoder.feed(line)) is not None]
    if len(found) != 1:
        raise StateError(f"not a message: {data[:80]!r}")
    return found[0]
