"""How a typed message is coded in a DBC: which message, which signals, which units, which protection. Pure.

`FrameFormat` translates one kind of message in both directions. cantools moves the bits. The checks that it leaves out
on decoding (length, range, meaning) and the SI conversion are here; their numbers are computed once, at construction.
"""

from __future__ import annotations

from dataclasses import field, fields
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

from positioner.errors import PositionerError
from positioner.values import dataclass
from positioner.wire import e2e
from positioner.wire.messages import CanFrame, Counted, Message
from positioner.wire.signals import UnfitSignalError, check_numbers, counter_modulus, is_plain_integer, raw_range

if TYPE_CHECKING:
    from collections.abc import Mapping
    from enum import IntEnum

    from cantools.database.can.message import Message as DbcMessage
    from cantools.database.can.signal import Signal

SI_PER_UNIT: Mapping[str, Mapping[str, float]] = {
    "m_per_s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "ma": {"mA": 1.0, "uA": 1e-3, "µA": 1e-3, "A": 1e3},
    "pa": {"Pa": 1.0, "kPa": 1e3, "hPa": 1e2, "mbar": 1e2, "bar": 1e5, "psi": 6894.757},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6},
}
"""Unit of a field (its suffix) → unit of a DBC signal → factor from the second to the first."""

_MARGIN_BITS = 0.25
"""A value may be so far beyond its range: enough for rounding errors, too little for the next bit."""


class FrameRejectedError(PositionerError):
    """A frame that is not accepted: `counted` says why, None for the traffic of other nodes, which is not counted."""

    def __init__(self, counted: Counted | None, detail: str) -> None:
        self.counted = counted
        super().__init__(f"{counted.text if counted is not None else 'unknown identifier'}: {detail}")


class EncodingError(PositionerError):
    """A message that does not fit its frame: a value that is not finite or out of the signal's range."""


@dataclass(frozen=True, slots=True)
class FieldFormat:
    """One field of a message in one signal: value = raw * `si_per_bit` + `si_offset`, in the unit of its suffix.

    `lowest` and `highest` are the signal's range in the same unit, with a margin for rounding. `choices` maps the
    value to the member of an enumeration or a bool; None for a plain number. `float_bits` is the length of a
    floating-point signal, 0 for an integer.
    """

    name: str
    signal: str
    si_per_bit: float
    si_offset: float
    lowest: float
    highest: float
    choices: Mapping[float, IntEnum | bool] | None
    float_bits: int = 0


def field_format(kind: type[Message], name: str, signal: Signal, span_m: float) -> FieldFormat:
    """Return how field `name` of `kind` is coded in `signal`; 100 % of a position is `span_m`.

    Raises:
        UnfitSignalError: the signal's unit does not fit the field, or its scale does not fit a count or a state.
    """
    check_numbers(signal)
    meaning = _meaning_of(kind, name)
    low_raw, high_raw = raw_range(signal)
    if low_raw > high_raw:
        raise UnfitSignalError(f"has the range {signal.minimum} to {signal.maximum}, which holds no value")
    margin = 0.0 if signal.is_float else _MARGIN_BITS
    if meaning is not float:
        if not is_plain_integer(signal):
            raise UnfitSignalError(f"is scaled or fractional, and {name} needs whole numbers")
        choices = None if meaning is int else MappingProxyType(_choices(meaning))
        # integers on purpose: a raw integer times 1 plus 0 stays one
        return FieldFormat(name, signal.name, 1, 0, low_raw - margin, high_raw + margin, choices)
    factor, offset = _si_of_unit(name, signal.unit or "", span_m)
    si_per_bit, si_offset = signal.scale * factor, signal.offset * factor + offset
    ends = [raw * si_per_bit + si_offset for raw in (low_raw - margin, high_raw + margin)]
    float_bits = signal.length if signal.is_float else 0
    return FieldFormat(name, signal.name, si_per_bit, si_offset, min(ends), max(ends), None, float_bits)


@dataclass(frozen=True, slots=True)
class FrameFormat:
    """One kind of message in one DBC frame.

    `data_id` is None where the frame carries no protection; `counter` names its counter signal, None without one.
    `counter_modulus` is the number of counts before the counter wraps: 256 in our frames, by its signal's range in a
    user's.
    """

    kind: type[Message]
    dbc: DbcMessage
    arbitration_id: int
    fields: tuple[FieldFormat, ...]
    data_id: int | None
    counter: str | None
    counter_modulus: int = field(init=False)
    _idle_raw: dict[str, float] = field(init=False, repr=False, compare=False)
    """Raw value of every signal before the fields are filled in: the DBC's start value, or 0. Only ever copied."""

    def __post_init__(self) -> None:
        """Compute the numbers that every frame needs."""
        modulus = counter_modulus(self.dbc.get_signal_by_name(self.counter)) if self.counter else e2e.COUNTER_MODULUS
        object.__setattr__(self, "counter_modulus", modulus)
        idle_raw = {signal.name: signal.raw_initial or 0 for signal in self.dbc.signals}
        object.__setattr__(self, "_idle_raw", idle_raw)

    def decode(self, frame: CanFrame) -> tuple[Message, int | None]:
        """Return the message and its counter.

        Raises:
            FrameRejectedError: wrong length, CRC, range or meaning.
        """
        data = frame.data
        if len(data) != self.dbc.length:
            raise FrameRejectedError(
                Counted.WRONG_LENGTH, f"{self.dbc.name} has {len(data)} bytes instead of {self.dbc.length}"
            )
        if self.data_id is not None and not e2e.is_intact(data, self.data_id):
            raise FrameRejectedError(Counted.WRONG_CRC, f"{self.dbc.name} data {data.hex(' ')}")
        raw: dict[str, Any] = self.dbc.decode(data, decode_choices=False, scaling=False)  # type: ignore[assignment]
        values = {}
        for form in self.fields:
            value = raw[form.signal] * form.si_per_bit + form.si_offset
            if not form.lowest <= value <= form.highest:  # NaN fails as well
                raise self._rejected(Counted.OUT_OF_RANGE, form, value)
            if form.choices is not None:
                if value not in form.choices:
                    raise self._rejected(Counted.UNDEFINED_VALUE, form, value)
                value = form.choices[value]
            values[form.name] = value
        counter: int | None = raw[self.counter] if self.counter else None
        if counter is not None and counter >= self.counter_modulus:
            raise FrameRejectedError(Counted.OUT_OF_RANGE, f"{self.dbc.name}.{self.counter} = {counter}")
        return self.kind(**values), counter

    def encode(self, message: Message, counter: int) -> CanFrame:
        """Return the frame of `message` under the running `counter` (taken modulo `counter_modulus`).

        A value is rounded to the nearest bit; None becomes 0.

        Raises:
            EncodingError: a value that is not finite or out of its signal's range.
        """
        raw = self._idle_raw.copy()
        for form in self.fields:
            value = getattr(message, form.name) or 0
            if not form.lowest <= value <= form.highest:  # NaN fails as well
                raise EncodingError(f"{self.dbc.name}.{form.signal}: {form.name} = {value:g} is out of range")
            raw[form.signal] = (value - form.si_offset) / form.si_per_bit
        if self.counter:
            raw[self.counter] = counter % self.counter_modulus
        payload = self.dbc.encode(raw, scaling=False, strict=False)
        if self.data_id is not None:
            payload = e2e.protect(payload, self.data_id)
        return CanFrame(self.arbitration_id, payload, self.dbc.is_extended_frame)

    def _rejected(self, counted: Counted, form: FieldFormat, value: float) -> FrameRejectedError:
        return FrameRejectedError(counted, f"{self.dbc.name}.{form.signal}: {form.name} = {value:g}")


def field_names(kind: type[Message]) -> tuple[str, ...]:
    """Return the names of a message's fields."""
    return tuple(each.name for each in fields(kind))


@lru_cache
def _hints(kind: type[Message]) -> dict[str, Any]:
    return get_type_hints(kind)


def _meaning_of(kind: type[Message], name: str) -> type[Any]:
    """Return the type of a message's field: float, int, bool or an enumeration (without its None)."""
    hint = _hints(kind)[name]  # type: ignore[arg-type]
    return next(arg for arg in (get_args(hint) or (hint,)) if arg is not type(None))  # type: ignore[no-any-return]


def _choices(meaning: type[Any]) -> dict[float, IntEnum | bool]:
    return {int(member): member for member in ((False, True) if meaning is bool else meaning)}


def _si_of_unit(name: str, unit: str, span_m: float) -> tuple[float, float]:
    """Return factor and offset from `unit` to the unit in the suffix of field `name`."""
    if unit == "%" and name.endswith("_ma"):
        return 0.16, 4.0
    if unit == "%" and name.endswith("_m"):
        return span_m / 100.0, 0.0
    suffix = next(suffix for suffix in SI_PER_UNIT if name.endswith(f"_{suffix}"))
    if unit not in SI_PER_UNIT[suffix]:
        raise UnfitSignalError(f"has the unit '{unit}', which does not fit {name}")
    return SI_PER_UNIT[suffix][unit], 0.0
