"""The rows of an export: the frames of a log that hold messages, and what was left out. Shell.

A log is read twice, first for the messages that occur in it: it may be larger than the memory.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from positioner.errors import UsageError
from positioner.inputs.nearest import nearest
from positioner.inputs.plain_file import MOST_MIB
from positioner.replay.log import LogError, read_log

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from positioner.export.signals import Message, Messages, Signal, Value
    from positioner.replay.log import BusLog, LogFrame

_MICRO = 6
"""Digits of an instant in s: a log's stamps carry no more."""
_MOST_NAMED = 5


@dataclass(frozen=True, slots=True)
class Group:
    """The exported signals of one message, and where they stand among all of its signals."""

    message: Message
    signals: tuple[Signal, ...]
    places: tuple[int, ...]


@dataclass(slots=True)
class LeftOut:
    """The frames that are not in the export: how many for each reason, and the identifiers that no message has."""

    frames: Counter[str] = field(default_factory=Counter)
    identifiers: Counter[str] = field(default_factory=Counter)

    def add(self, logged: LogFrame, reason: str) -> None:
        """Count one frame."""
        self.frames[reason] += 1
        if reason == "unknown identifier":
            frame = logged.frame
            self.identifiers[f"{frame.arbitration_id:0{8 if frame.is_extended else 3}X}"] += 1

    def lines(self) -> tuple[str, ...]:
        """Return a line for each reason."""
        named = ", ".join(name for name, _ in self.identifiers.most_common(_MOST_NAMED))
        more = ", ..." if len(self.identifiers) > _MOST_NAMED else ""
        texts = {"unknown identifier": f" ({named}{more})"}
        return tuple(
            f"{number} frame{'s' if number > 1 else ''} left out: {reason}{texts.get(reason, '')}"
            for reason, number in self.frames.items()
        )


class LogRows:
    """The log of a bus as rows: the instant, the group of signals and their values."""

    def __init__(self, path: Path, messages: Messages, wanted: Sequence[str] = (), most_mib: int = MOST_MIB) -> None:
        """Read the log once; `wanted` are patterns of columns or of messages, none for all.

        Raises:
            LogError: it cannot be read, or holds no message.
            UsageError: nothing in it has a wanted name.
        """
        self._messages = messages
        self.left_out = LeftOut()
        seen: Counter[int] = Counter()
        by_key = {id(message): message for message in messages.by_id.values()}

        def look(logged: LogFrame) -> None:
            message, reason = messages.in_frame(logged.frame)
            if message is None:
                self.left_out.add(logged, reason)
            else:
                seen[id(message)] += 1

        self.log: BusLog = read_log(path, look, most_mib)
        if not seen:
            text = "; ".join(self.left_out.lines())
            raise LogError(f"{path}: holds no message that [wire] or our DBC describes: {text}")
        groups = [_group(message, wanted) for key, message in by_key.items() if key in seen]
        self.groups = tuple(group for group in groups if group.signals)
        for pattern in wanted:
            if not any(_group(group.message, [pattern]).signals for group in self.groups):
                names = [signal.column for group in groups for signal in group.message.signals]
                raise UsageError(
                    f"--signals '{pattern}': no signal in the log has this name; {nearest(pattern, names)}"
                )
        self.count = sum(seen[id(group.message)] for group in self.groups)
        self._numbers = {id(group.message): number for number, group in enumerate(self.groups)}

    def __iter__(self) -> Iterator[tuple[float, int, list[Value]]]:
        """Yield each row, read from the log again: its instant in s, the number of its group, the group's values."""
        for logged in self.log.frames():
            message, _ = self._messages.in_frame(logged.frame)
            number = self._numbers.get(id(message))
            if message is None or number is None:
                continue
            values = message.values(logged.frame.data)
            group = self.groups[number]
            if len(values) > len(group.places):
                values = [values[place] for place in group.places]
            yield round(self.log.instant_s(logged), _MICRO), number, values


def _group(message: Message, wanted: Sequence[str]) -> Group:
    chosen = [
        (place, signal)
        for place, signal in enumerate(message.signals)
        if not wanted or any(_fits(pattern, message, signal) for pattern in wanted)
    ]
    return Group(message, tuple(signal for _, signal in chosen), tuple(place for place, _ in chosen))


def _fits(pattern: str, message: Message, signal: Signal) -> bool:
    """Return whether a name of the signal fits; capitals count where the pattern has any."""
    bare = signal.column.partition("/")[2]
    names = (signal.column, bare, f"{message.name}/{signal.name}", signal.name, message.name)
    any_case = pattern == pattern.lower()
    return any(fnmatchcase(name.lower() if any_case else name, pattern) for name in names)
