"""How a typed message is coded in a frame: its fields' bits, its counter and its protection. Pure.

`FrameFormat` translates one kind of message in both directions, and checks length, CRC, range and meaning. Every frame
passes here, so all that follows from the DBC is computed once, at construction.
"""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from typing import TYPE_CHECKING, Any

from positioner.errors import PositionerError
from positioner.wire import e2e, layout
from positioner.wire.fields import field_names
from positioner.wire.messages import CanFrame, Counted, Message
from positioner.wire.signals import counter_modulus

if TYPE_CHECKING:
    from cantools.database.can.message import Message as DbcMessage

    from positioner.wire.fields import FieldFormat
    from positioner.wire.layout import Place

_TABLE_MASK = 0xFF
"""A longer count has no table of its values."""


class FrameRejectedError(PositionerError):
    """A frame that is not accepted: `counted` says why, None for the traffic of other nodes, which is not counted."""

    def __init__(self, counted: Counted | None, detail: str) -> None:
        self.counted = counted
        super().__init__(f"{counted.text if counted is not None else 'unknown identifier'}: {detail}")


class EncodingError(PositionerError):
    """A message that does not fit its frame: a value that is not finite or out of the signal's range."""


class PlacedField:
    """A field and its bits in a frame (see `layout`); immutable by convention.

    `index` is the field's place in its message. `meanings` are the values by their bits: of an enumeration, or of a
    count of up to eight bits.
    """

    __slots__ = (
        *("name", "signal", "index", "shift", "mask", "sign", "floating"),
        *("si_per_bit", "si_offset", "lowest", "highest", "is_whole", "meanings"),
    )

    def __init__(self, form: FieldFormat, index: int, place: Place) -> None:
        self.name, self.signal, self.index = form.name, form.signal, index
        self.shift, self.mask, self.sign, self.floating = place.shift, place.mask, place.sign, place.floating
        self.si_per_bit, self.si_offset = form.si_per_bit, form.si_offset
        self.lowest, self.highest, self.is_whole = form.lowest, form.highest, form.is_whole
        self.meanings: dict[int, int] | None = None
        if form.choices is not None:
            meant = {int(raw): meaning for raw, meaning in form.choices.items() if form.lowest <= raw <= form.highest}
            self.meanings = {raw & place.mask: meaning for raw, meaning in meant.items()}
        elif form.is_whole and place.mask <= _TABLE_MASK:
            counts = range(math.ceil(form.lowest), math.floor(form.highest) + 1)
            self.meanings = {raw & place.mask: raw for raw in counts}


class FrameFormat:
    """One kind of message in one DBC frame; immutable by convention.

    `data_id` is None where the frame carries no protection; `counter` names its counter signal, None without one.
    `counter_modulus` is the number of counts before the counter wraps: 256 in our frames, by its signal's range in a
    user's.
    """

    def __init__(
        self,
        kind: type[Message],
        dbc: DbcMessage,
        arbitration_id: int,
        field_formats: tuple[FieldFormat, ...],
        data_id: int | None,
        counter: str | None,
    ) -> None:
        self.kind = kind
        self.dbc = dbc
        self.arbitration_id = arbitration_id
        self.is_extended: bool = dbc.is_extended_frame
        self.fields = field_formats
        self.data_id = data_id
        self.counter = counter
        self.counter_modulus: int = e2e.COUNTER_MODULUS
        names = field_names(kind)
        self._length: int = dbc.length
        self._is_mixed = layout.is_mixed(dbc)
        self._counter_place = layout.NOWHERE
        if counter:
            self.counter_modulus = counter_modulus(dbc.get_signal_by_name(counter))
            self._counter_place = layout.place_of(dbc.get_signal_by_name(counter), dbc.length)
        self._placed = [
            PlacedField(form, names.index(form.name), layout.place_of(dbc.get_signal_by_name(form.signal), dbc.length))
            for form in field_formats
        ]
        sent = {counter, *(form.signal for form in field_formats)}
        self._start_word = layout.start_word(dbc, [signal for signal in dbc.signals if signal.name not in sent])
        # for fields without a signal; the first field of a message has no default, and always a signal
        self._defaults = [None if each.default is MISSING else each.default for each in fields(kind)]

    def placed(self, name: str) -> PlacedField:
        """Return the field `name` with its bits."""
        return next(field for field in self._placed if field.name == name)

    def decode(self, frame: CanFrame) -> tuple[Message, int | None]:
        """Return the message and its counter.

        Raises:
            FrameRejectedError: wrong length, CRC, range or meaning.
        """
        data = frame.data
        if len(data) != self._length:
            text = f"{self.dbc.name} has {len(data)} bytes instead of {self._length}"
            raise FrameRejectedError(Counted.WRONG_LENGTH, text)
        if self.data_id is not None and not e2e.is_intact(data, self.data_id):
            raise FrameRejectedError(Counted.WRONG_CRC, f"{self.dbc.name} data {data.hex(' ')}")
        word = layout.mixed_word(data) if self._is_mixed else int.from_bytes(data, "little")
        values: list[Any] = self._defaults.copy()
        value: Any
        for field in self._placed:
            bits = word >> field.shift & field.mask
            if field.meanings is not None:
                value = field.meanings.get(bits)
                if value is None:
                    raise self._meaningless(field, (bits ^ field.sign) - field.sign)
            else:
                raw = layout.number_of(bits, field.floating) if field.floating else (bits ^ field.sign) - field.sign
                value = raw if field.is_whole else raw * field.si_per_bit + field.si_offset
                if not field.lowest <= value <= field.highest:  # NaN fails as well
                    raise self._rejected(Counted.OUT_OF_RANGE, field, value)
            values[field.index] = value
        if self.counter is None:
            return self.kind(*values), None
        count = word >> self._counter_place.shift & self._counter_place.mask
        if count >= self.counter_modulus:
            raise FrameRejectedError(Counted.OUT_OF_RANGE, f"{self.dbc.name}.{self.counter} = {count}")
        return self.kind(*values), count

    def encode(self, message: Message, counter: int) -> CanFrame:
        """Return the frame of `message` under the running `counter` (taken modulo `counter_modulus`).

        A value is rounded to the nearest bit; None becomes 0. Signals without a field have the DBC's start value, or 0.

        Raises:
            EncodingError: a value that is not finite or out of its signal's range.
        """
        word = self._start_word
        for field in self._placed:
            value = getattr(message, field.name) or 0
            if not field.lowest <= value <= field.highest:  # NaN fails as well
                raise EncodingError(f"{self._named(field)} = {value:g} is out of range")
            if field.is_whole:
                bits = value & field.mask
            elif field.floating:
                bits = layout.bits_of((value - field.si_offset) / field.si_per_bit, field.floating)
            else:
                bits = round((value - field.si_offset) / field.si_per_bit) & field.mask
            word |= bits << field.shift
        if self.counter is not None:
            word |= counter % self.counter_modulus << self._counter_place.shift
        payload = (layout.of_mixed_word(word, self._length) if self._is_mixed else word).to_bytes(
            self._length, "little"
        )
        if self.data_id is not None:
            payload = e2e.protect(payload, self.data_id)
        return CanFrame(self.arbitration_id, payload, self.is_extended)

    def _meaningless(self, field: PlacedField, raw: int) -> FrameRejectedError:
        within = field.lowest <= raw <= field.highest
        return self._rejected(Counted.UNDEFINED_VALUE if within else Counted.OUT_OF_RANGE, field, raw)

    def _rejected(self, counted: Counted, field: PlacedField, value: float) -> FrameRejectedError:
        return FrameRejectedError(counted, f"{self._named(field)} = {value:g}")

    def _named(self, field: PlacedField) -> str:
        """Return message, signal and field in words."""
        return f"{self.dbc.name}.{field.signal}: {field.name}"
