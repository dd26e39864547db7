"""Which frames a receiver must accept: an independent check that shares no code with the positioner.

The CRC is that of the package autosar-e2e; the fields are cut out of the bytes by hand; the counters follow the
text of DESIGN.md. A frame that was damaged or made up at random and still fits is *valid by accident*: the wire
cannot distinguish it from a true one, and for the oracle it must be accepted.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from e2e import p05

if TYPE_CHECKING:
    from positioner.wire.messages import CanFrame

LENGTH = 8
STRAY = "DISARM out of sequence"
"""The verdict on a frame whose DISARM is obeyed and of which nothing else is taken."""


@dataclass(frozen=True)
class Signal:
    """Bits of a frame, little endian, with the raw values that it may have."""

    start: int
    length: int
    low: int
    high: int
    never: frozenset[int] = frozenset()

    def may_be(self, raw: int) -> bool:
        return self.low <= raw <= self.high and raw not in self.never

    def raw(self, data: bytes) -> int:
        word = int.from_bytes(data, "little") >> self.start & ((1 << self.length) - 1)
        return word - (1 << self.length) if self.low < 0 and word >> (self.length - 1) else word


@dataclass(frozen=True)
class Kind:
    """One kind of frame: its data ID, its ranges (their breach is 'value out of range') and its enumerations."""

    name: str
    data_id: int
    ranges: tuple[Signal, ...] = ()
    choices: tuple[Signal, ...] = ()


_RETIRED = frozenset({8, 9, 11})
"""Causes that no status ever gave; they have been removed."""

KINDS = {
    0x100: Kind(
        *("CURRENT_COMMAND", 0x1F00, (Signal(24, 16, 0, 25000),)),
        (Signal(56, 4, 0, 5), Signal(60, 4, 0, 3)),
    ),
    0x110: Kind("STEM_POSITION", 0x1F10, (Signal(24, 28, -134200000, 134200000),), (Signal(60, 4, 0, 3),)),
    0x111: Kind("ACTUATOR_STATE", 0x1F11, (Signal(24, 24, 0, 16000000),)),
    0x120: Kind("SETPOINT", 0x1F20, (Signal(24, 28, -134200000, 134200000),), (Signal(52, 4, 0, 2),)),
    0x121: Kind("MANUAL_CURRENT", 0x1F21, (Signal(24, 16, 0, 25000),), (Signal(40, 4, 0, 1),)),
    0x140: Kind(
        "POSITIONER_STATUS", 0x1F40, (), (Signal(24, 4, 0, 5), Signal(28, 4, 0, 4), Signal(32, 6, 0, 25, _RETIRED))
    ),
    0x141: Kind("POSITIONER_COUNT", 0x1F41, (), (Signal(24, 8, 1, 20),)),
    0x142: Kind("POSITIONER_ALARMS", 0x1F42, (), (Signal(24, 4, 0, 4),)),
    0x170: Kind("PLANT_TRUTH", 0x1F70, (Signal(24, 26, 0, 67100000), Signal(50, 14, -8191, 8191))),
}


def verdict_of(frame: CanFrame) -> str:
    """Return 'good', or the reason in words why `frame` must not be accepted, whatever its counter."""
    kind = None if frame.is_extended else KINDS.get(frame.arbitration_id)
    reasons = (
        (frame.is_error, "error frame"),
        (kind is None, "unknown identifier"),
        (frame.is_remote, "remote frame"),
        (len(frame.data) != LENGTH, "wrong length"),
    )
    why = next((words for holds, words in reasons if holds), "good")
    return why if kind is None or why != "good" else _content_of(kind, frame.data)


def _content_of(kind: Kind, data: bytes) -> str:
    if not p05.e2e_p05_check(data, kind.data_id):
        return "wrong CRC"
    if any(not signal.may_be(signal.raw(data)) for signal in kind.ranges):
        return "value out of range"
    if any(not signal.may_be(signal.raw(data)) for signal in kind.choices):
        return "undefined value"
    return "good"


@dataclass
class Book:
    """The counters of one sender: the last one, one that waits for its successor, and those that may come late."""

    last: int | None = None
    waiting: int | None = None
    gaps: set[int] = field(default_factory=set)
    bytes_: bytes = b""
    verdicts: list[bool] = field(default_factory=list)
    disputed: bool = False

    def add(self, in_order: bool) -> None:
        """Add one verdict to the window: 4 wrong ones of 64 begin a dispute, 16 right ones in a row end it."""
        self.verdicts = [*self.verdicts, in_order][-64:]
        if self.disputed and all(self.verdicts[-16:]):
            self.verdicts, self.disputed = [], False
        self.disputed = self.disputed or self.verdicts.count(False) > 3


@dataclass
class Ledger:
    """Counters as DESIGN.md describes them: a step of up to 11 is a loss; a larger one needs the frame that follows it.

    A missing frame that comes up to three counts late was overtaken: it is refused, without another consequence.
    """

    books: dict[int, Book] = field(default_factory=dict)
    lost: int = 0

    def enter(self, identifier: int, data: bytes) -> str:
        """Return 'good', 'repeated counter', 'counter out of order' or STRAY, and update the counters.

        A DISARM that is not in sequence is no evidence of a second sender: it leaves the window as it is.
        """
        book, counter = self.books.setdefault(identifier, Book()), data[2]
        waiting, book.waiting = book.waiting, None
        stray = identifier == 0x120 and disarms(data)
        if book.last == counter:
            if data != book.bytes_ and not stray:
                book.add(in_order=False)
            return STRAY if stray else "repeated counter"
        distance = 1 if book.last is None else (counter - book.last) % 256
        if distance <= 11 or (waiting is not None and counter == (waiting + 1) % 256 and counter not in book.gaps):
            skipped = {(counter - step) % 256 for step in range(1, distance)} if distance <= 11 else set()
            kept = book.gaps if distance <= 11 else set()
            book.gaps = {each for each in kept | skipped if (counter - each) % 256 <= 3}
            self.lost += distance - 1 if distance <= 11 else 0
            book.last, book.bytes_ = counter, data
            book.add(in_order=True)
            return "good"
        if counter in book.gaps:
            book.gaps.remove(counter)
            return STRAY if stray else "counter out of order"
        book.waiting = counter
        if stray:
            return STRAY
        book.add(in_order=False)
        return "counter out of order"

    def believes(self, identifier: int) -> bool:
        """Return whether there seems to be one sender only; a reading after a wrong frame waits for two in order."""
        book = self.books.get(identifier)
        if book is None or identifier not in {0x110, 0x120, 0x121}:
            return True
        return not book.disputed and (identifier != 0x110 or all(book.verdicts[-2:]))


def disarms(data: bytes) -> bool:
    """Return whether an intact SETPOINT frame asks to disarm."""
    return KINDS[0x120].choices[0].raw(data) == 2
