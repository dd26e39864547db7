"""The signals of each message of a bus: their columns, units and comments, and their values in a frame. Pure.

Every signal of the DBC is here, also counters, checksums and what the positioner does not read. A signal that the
positioner reads has the value that the codec gives it, to the bit.
"""

from __future__ import annotations

from itertools import chain, count
from typing import TYPE_CHECKING, TypeAlias

from positioner.export.units import SI_UNITS, UNIT_OF_SUFFIX, column_name
from positioner.values import dataclass
from positioner.wire import e2e, layout
from positioner.wire.messages import PlantTruth
from positioner.wire.signals import UnfitSignalError, check_numbers, is_plain_integer

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from cantools.database.can.message import Message as DbcMessage
    from cantools.database.can.signal import Signal as DbcSignal

    from positioner.wire.codec import Codec
    from positioner.wire.fields import FieldFormat
    from positioner.wire.formats import FrameFormat
    from positioner.wire.layout import Place
    from positioner.wire.messages import CanFrame

Value: TypeAlias = "float | int | None"
"""An integer where the signal is one, None where the frame does not hold the signal (multiplexed messages)."""


@dataclass(frozen=True, slots=True)
class Signal:
    """One signal: value = raw * `si_per_bit` + `si_offset` in `unit`, or the raw value itself where `is_whole`.

    `choices` names raw values. `selector` is the place of the multiplexor among the message's signals, and `selected`
    the values of it with which a frame holds this signal.
    """

    column: str
    name: str
    unit: str
    comment: str
    choices: Mapping[int, str]
    place: Place
    si_per_bit: float
    si_offset: float
    is_whole: bool
    selector: int | None = None
    selected: frozenset[int] = frozenset()

    @property
    def meaning(self) -> str:
        """The comment, and the names of the values."""
        named = ", ".join(f"{value} {name}" for value, name in self.choices.items())
        return "; ".join(filter(None, (self.comment.strip(), named)))


@dataclass(frozen=True, slots=True)
class Message:
    """One message and its signals; `data_id` is None where the frame carries no checksum of ours."""

    name: str
    comment: str
    length: int
    data_id: int | None
    is_mixed: bool
    signals: tuple[Signal, ...]

    def why_not(self, data: bytes) -> str:
        """Return why the signals of a frame cannot be read; empty where they can.

        A frame without a checksum may be longer than the DBC says.
        """
        if len(data) < self.length or (self.data_id is not None and len(data) != self.length):
            return "wrong length"
        return "wrong CRC" if self.data_id is not None and not e2e.is_intact(data, self.data_id) else ""

    def values(self, data: bytes) -> list[Value]:
        """Return the value of each signal in the bytes of a frame."""
        data = data[: self.length]
        word = layout.mixed_word(data) if self.is_mixed else int.from_bytes(data, "little")
        raws = [_raw(word, signal.place) for signal in self.signals]
        return [
            (raw if signal.is_whole else raw * signal.si_per_bit + signal.si_offset)
            if signal.selector is None or self._holds(signal, raws)
            else None
            for signal, raw in zip(self.signals, raws, strict=True)
        ]

    def _holds(self, signal: Signal, raws: Sequence[float]) -> bool:
        """Return whether a frame with these raw values holds `signal`: each multiplexor above it must select it."""
        while signal.selector is not None:
            if raws[signal.selector] not in signal.selected:
                return False
            signal = self.signals[signal.selector]
        return True


def _raw(word: int, place: Place) -> float | int:
    bits = word >> place.shift & place.mask
    return layout.number_of(bits, place.floating) if place.floating else (bits ^ place.sign) - place.sign


class Messages:
    """The messages of a bus by their identifiers; immutable by convention.

    `left_out` has a line for each signal of the DBC that no number can hold.
    """

    def __init__(self, codec: Codec, user_messages: Iterable[DbcMessage] = ()) -> None:
        """Take the messages of `codec`, and the others of the user's DBC."""
        found: dict[tuple[int, bool], _Described] = {}
        formats = dict(codec.by_kind)
        truth = formats.pop(PlantTruth)  # only a bench sends it: a message of the user's has precedence
        found[codec.identifier(PlantTruth)] = _Described.of(truth)
        found |= {(dbc.frame_id, dbc.is_extended_frame): _Described(dbc, None, {}) for dbc in user_messages}
        found |= {codec.identifier(kind): _Described.of(form) for kind, form in formats.items()}
        self.left_out: list[str] = []
        taken: set[str] = set()
        self.by_id = {identifier: self._message(each, taken) for identifier, each in found.items()}

    def in_frame(self, frame: CanFrame) -> tuple[Message | None, str]:
        """Return the message in a frame, or None and the reason: no message, or nothing that can be read."""
        if frame.is_error:
            return None, "error frame"
        message = self.by_id.get(frame.identifier)
        if message is None:
            return None, "unknown identifier"
        reason = "remote frame" if frame.is_remote else message.why_not(frame.data)
        return (None, reason) if reason else (message, "")

    def _message(self, described: _Described, taken: set[str]) -> Message:
        """Return the message, with columns that are not yet `taken`."""
        dbc, kept = described.dbc, []
        for signal in dbc.signals:
            try:
                check_numbers(signal)
            except UnfitSignalError as error:
                self.left_out.append(f"{dbc.name}.{signal.name} {error}")
            else:
                kept.append(signal)
        names = [signal.name for signal in kept]
        signals = tuple(_signal(dbc, signal, described.fields.get(signal.name), names, taken) for signal in kept)
        comment = dbc.comment or ""
        return Message(dbc.name, comment, dbc.length, described.data_id, layout.is_mixed(dbc), signals)


@dataclass(frozen=True, slots=True)
class _Described:
    """A message of a DBC, the data ID of its checksum, and the formats of the signals that the positioner reads."""

    dbc: DbcMessage
    data_id: int | None
    fields: Mapping[str, FieldFormat]

    @staticmethod
    def of(form: FrameFormat) -> _Described:
        return _Described(form.dbc, form.data_id, {each.signal: each for each in form.fields})


def _signal(
    dbc: DbcMessage, signal: DbcSignal, field: FieldFormat | None, names: Sequence[str], taken: set[str]
) -> Signal:
    unit, factor = SI_UNITS.get(signal.unit or "", (signal.unit or "", 1.0))
    per_bit, offset = float(signal.scale) * factor, float(signal.offset) * factor
    is_whole = is_plain_integer(signal) and factor == 1.0
    if field is not None:
        unit = next((unit for suffix, unit in UNIT_OF_SUFFIX.items() if field.name.endswith(suffix)), unit)
        per_bit, offset, is_whole = field.si_per_bit, field.si_offset, field.is_whole
    column = column_name(dbc.name, signal.name, signal.unit or "", unit)
    column = next(each for each in chain([column], (f"{column}_{number}" for number in count(2))) if each not in taken)
    taken.add(column)
    selector = signal.multiplexer_signal
    return Signal(
        column=column,
        name=signal.name,
        unit=unit,
        comment=signal.comment or "",
        choices={int(raw): str(name) for raw, name in (signal.choices or {}).items()},
        place=layout.place_of(signal, dbc.length),
        si_per_bit=per_bit,
        si_offset=offset,
        is_whole=is_whole,
        selector=names.index(selector) if selector in names else None,
        selected=frozenset(signal.multiplexer_ids or ()),
    )
