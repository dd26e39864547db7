"""What daemon, keeper and command line tell each other, one JSON line each."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, TypeAlias

from positioner.errors import StateError
from positioner.stiction import Direction, LearnedSample, Quantity
from positioner.store import document
from positioner.store.content import StoredTable

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True, slots=True)
class Open:
    """Daemon → keeper, first: which table; `known` is what the daemon knows already, if the keeper was restarted."""

    directory: str
    valve_id: str
    cell_width_m: float
    known: StoredTable | None


@dataclass(frozen=True, slots=True)
class Opened:
    """Keeper → daemon: the table as it was found, and what was noteworthy about it."""

    stored: StoredTable
    notices: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Learn:
    """Daemon → keeper: samples, in the order in which they were recorded."""

    generation: int
    samples: tuple[LearnedSample, ...]


@dataclass(frozen=True, slots=True)
class Adopt:
    """Daemon → keeper: the whole table, in place of samples that could not be sent one by one."""

    stored: StoredTable


@dataclass(frozen=True, slots=True)
class Close:
    """Daemon → keeper: save, answer `Closed`, end."""


@dataclass(frozen=True, slots=True)
class Closed:
    """Keeper → daemon: everything is saved, or why it is not."""

    problem: str | None


@dataclass(frozen=True, slots=True)
class Saved:
    """Keeper → daemon: the table up to `sequence` is on the disk."""

    generation: int
    sequence: int


@dataclass(frozen=True, slots=True)
class Replaced:
    """Keeper → daemon: the table was replaced by command; `reason` says by which and where the former one is."""

    stored: StoredTable
    reason: str


@dataclass(frozen=True, slots=True)
class SavingFailed:
    """Keeper → daemon, once: the table cannot be saved; why, and what to do."""

    reason: str


@dataclass(frozen=True, slots=True)
class SavingWorks:
    """Keeper → daemon, once: the table could be saved again."""


@dataclass(frozen=True, slots=True)
class Notice:
    """Keeper → daemon: a line for the log."""

    text: str

    def __str__(self) -> str:
        """The line itself."""
        return self.text


@dataclass(frozen=True, slots=True)
class DumpRequest:
    """Command line → keeper: what is in the table?"""


@dataclass(frozen=True, slots=True)
class ResetRequest:
    """Command line → keeper: back the table up and empty it."""


@dataclass(frozen=True, slots=True)
class ImportRequest:
    """Command line → keeper: back the table up and replace it; `force` takes another valve's table too."""

    stored: StoredTable
    force: bool


@dataclass(frozen=True, slots=True)
class Dumped:
    """Keeper → command line: the table."""

    stored: StoredTable


@dataclass(frozen=True, slots=True)
class Done:
    """Keeper → command line: the table was replaced; `backup` holds the former one, if it held anything."""

    backup: str | None


@dataclass(frozen=True, slots=True)
class Refused:
    """Keeper → command line: nothing was changed, and why."""

    reason: str


@dataclass(frozen=True, slots=True)
class Rejected:
    """Owner's process → root's: the file is no table; its `name` in the directory, the fault and the detail."""

    name: str
    fault: str
    detail: str


ToKeeper: TypeAlias = Open | Learn | Adopt | Close
FromKeeper: TypeAlias = Opened | Closed | Saved | Replaced | SavingFailed | SavingWorks | Notice
Request: TypeAlias = DumpRequest | ResetRequest | ImportRequest
Answer: TypeAlias = Dumped | Done | Refused | Rejected
Message: TypeAlias = ToKeeper | FromKeeper | Request | Answer

_KINDS: dict[str, Callable[..., Message]] = {kind.__name__: kind for kind in Message.__args__}


def encode(message: Message) -> bytes:
    """Return the message as one line."""
    plain = {field.name: _plain(getattr(message, field.name)) for field in fields(message)}
    return json.dumps({"kind": type(message).__name__, **plain}).encode()


def decode(line: bytes) -> Message:
    """Return the message in a line.

    Raises:
        StateError: the line is no message.
    """
    try:
        plain = json.loads(line)
        kind = _KINDS[plain.pop("kind")]
        return kind(**{name: _typed(name, value) for name, value in plain.items()})
    except (ValueError, TypeError, AttributeError, KeyError, RecursionError) as error:
        raise StateError(f"not a message: {line[:80]!r}") from error


def _plain(value: object) -> Any:
    if isinstance(value, StoredTable):
        return document.as_plain(value)
    if isinstance(value, LearnedSample):
        return [value.quantity, value.position_m, value.direction, value.value]
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return value


def _typed(name: str, value: Any) -> Any:
    if name in {"stored", "known"} and value is not None:
        return document.from_plain(value, "message")
    if name == "samples":
        return tuple(LearnedSample(Quantity(q), float(x), Direction(d), float(y)) for q, x, d, y in value)
    return tuple(value) if isinstance(value, list) else value
