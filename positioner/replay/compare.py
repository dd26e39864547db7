"""Recorded and computed frames side by side: how many are equal, and the first that differs, in words. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from itertools import zip_longest
from typing import TYPE_CHECKING

from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import CurrentCommand

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.replay.log import LogFrame
    from positioner.replay.run import ReplayedCycle
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

_UNITS = {"_ma": ("mA", 1.0, 3), "_m": ("mm", 1e3, 5)}


@dataclass(frozen=True, slots=True)
class Difference:
    """A frame that is not as recorded; one of the two is None where only the other exists.

    cause: the last frame that came in before it, if one did in its cycle.
    """

    time_ns: int
    name: str
    cause: LogFrame | None
    recorded: LogFrame | None
    computed: CanFrame | None


@dataclass(slots=True)
class FrameCounters:
    """Counts of one kind of frame."""

    recorded: int = 0
    computed: int = 0
    equal: int = 0
    differing: int = 0


@dataclass(slots=True)
class Comparison:
    """What `add` has seen so far: the counts of each kind of frame by its name, and the first difference."""

    codec: Codec
    exact: bool
    """Whether the log tells the instants: then frames that are due by time are compared, too."""
    counters: dict[str, FrameCounters] = field(default_factory=dict)
    first: Difference | None = None

    def add(self, replayed: ReplayedCycle) -> None:
        """Compare the frames of one cycle, those of a kind in their order."""
        compared = self._by_kind(replayed)
        for name, (recorded, computed) in compared.items():
            counts = self.counters.setdefault(name, FrameCounters())
            counts.recorded += len(recorded)
            counts.computed += len(computed)
            for logged, frame in zip_longest(recorded, computed):
                if logged is not None and frame is not None and logged.frame.data == frame.data:
                    counts.equal += 1
                    continue
                counts.differing += 1
                if self.first is None:
                    self.first = _difference(replayed, name, logged, frame)

    @property
    def identical(self) -> bool:
        """Whether every frame is as recorded."""
        return self.first is None

    def _by_kind(self, replayed: ReplayedCycle) -> dict[str, tuple[list[LogFrame], list[CanFrame]]]:
        found: dict[str, tuple[list[LogFrame], list[CanFrame]]] = {}
        for logged in replayed.recorded.outbox:
            found.setdefault(self._name(logged.frame), ([], []))[0].append(logged)
        for frame in replayed.computed:
            if self.exact or self._name(frame) == command_name(self.codec):
                found.setdefault(self._name(frame), ([], []))[1].append(frame)
        return found

    def _name(self, frame: CanFrame) -> str:
        return self.codec.by_id[frame.arbitration_id, frame.is_extended].dbc.name


def _difference(replayed: ReplayedCycle, name: str, logged: LogFrame | None, frame: CanFrame | None) -> Difference:
    cause = replayed.recorded.inbox[-1] if replayed.recorded.inbox else None
    return Difference(replayed.recorded.time_ns, name, cause, logged, frame)


def command_name(codec: Codec) -> str:
    """Return the name of the command frame in its DBC."""
    return codec.by_kind[CurrentCommand].dbc.name


def in_words(codec: Codec, difference: Difference) -> tuple[str, ...]:
    """Return what differs, a line each: the bytes, and what they mean."""
    recorded, computed = difference.recorded, difference.computed
    if recorded is None:
        told = f"  computed  {computed.data.hex(' ')}  {_said(codec, computed)}" if computed else ""
        return ("  recorded  nothing", told)
    if computed is None:
        return (f"  recorded  {recorded.frame.data.hex(' ')}  {_said(codec, recorded.frame)}", "  computed  nothing")
    lines = [f"  recorded  {recorded.frame.data.hex(' ')}", f"  computed  {computed.data.hex(' ')}"]
    try:
        theirs, their_counter = codec.decode(recorded.frame)
    except FrameRejectedError as error:
        return (*lines, f"  the recorded frame is not valid: {error}")
    ours, our_counter = codec.decode(computed)
    for name in _fields(theirs):
        one, other = getattr(theirs, name), getattr(ours, name)
        if one != other:
            lines.append(f"  {_spoken(name)} {_value(name, one)} recorded, {_value(name, other)} computed")
    if their_counter != our_counter:
        lines.append(f"  counter {their_counter} recorded, {our_counter} computed")
    return tuple(lines)


def _said(codec: Codec, frame: CanFrame) -> str:
    try:
        message, _ = codec.decode(frame)
    except FrameRejectedError as error:
        return str(error)
    return ", ".join(f"{_spoken(name)} {_value(name, getattr(message, name))}" for name in _fields(message))


def _fields(message: object) -> Sequence[str]:
    return tuple(type(message).__dataclass_fields__)  # type: ignore[attr-defined]


def _spoken(name: str) -> str:
    for suffix in _UNITS:
        name = name.removesuffix(suffix)
    return name.replace("_", " ")


def _value(name: str, value: object) -> str:
    if isinstance(value, Enum):
        return value.name
    for suffix, (unit, scale, digits) in _UNITS.items():
        if name.endswith(suffix) and isinstance(value, float):
            return f"{value * scale:.{digits}f} {unit}"
    return str(value)
