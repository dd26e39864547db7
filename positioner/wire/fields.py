"""How one field of a message is coded in one signal of a DBC: unit, range and meanings. Pure."""

from __future__ import annotations

import math
from dataclasses import fields
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

from positioner.values import dataclass
from positioner.wire.signals import UnfitSignalError, check_numbers, holds, is_plain_integer, raw_range

if TYPE_CHECKING:
    from collections.abc import Mapping
    from enum import IntEnum

    from cantools.database.can.signal import Signal

    from positioner.wire.messages import Message

SI_PER_UNIT: Mapping[str, Mapping[str, float]] = {
    "m_per_s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "ma": {"mA": 1.0, "uA": 1e-3, "µA": 1e-3, "A": 1e3},
    "pa": {"Pa": 1.0, "kPa": 1e3, "hPa": 1e2, "mbar": 1e2, "bar": 1e5, "psi": 6894.757},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6},
}
"""Unit of a field (its suffix) → unit of a DBC signal → factor from the second to the first."""

_MARGIN_BITS = 0.25
"""A value may be so far beyond its range: enough for rounding errors, too little for the next bit."""


@dataclass(frozen=True, slots=True)
class FieldFormat:
    """One field of a message in one signal: value = raw * `si_per_bit` + `si_offset`, in the unit of its suffix.

    `lowest` and `highest` are the signal's range in the same unit, with a margin for rounding. `choices` maps the
    value to the member of an enumeration or a bool; None for a plain number. `float_bits` is the length of a
    floating-point signal, 0 for an integer. `is_whole`: the raw value is the value.
    """

    name: str
    signal: str
    si_per_bit: float
    si_offset: float
    lowest: float
    highest: float
    choices: Mapping[float, IntEnum | bool] | None
    float_bits: int = 0
    is_whole: bool = False


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
        lowest, highest = _ends(signal, 1.0, 0.0, low_raw - margin, high_raw + margin)
        return FieldFormat(name, signal.name, 1.0, 0.0, lowest, highest, choices, is_whole=True)
    factor, offset = _si_of_unit(name, signal.unit or "", span_m)
    si_per_bit, si_offset = signal.scale * factor, signal.offset * factor + offset
    lowest, highest = _ends(signal, si_per_bit, si_offset, low_raw - margin, high_raw + margin)
    float_bits = signal.length if signal.is_float else 0
    return FieldFormat(name, signal.name, si_per_bit, si_offset, lowest, highest, None, float_bits)


def _ends(signal: Signal, si_per_bit: float, si_offset: float, low_raw: float, high_raw: float) -> tuple[float, float]:
    """Return the lowest and the highest value: every value between them fits the signal's bits when it is encoded.

    Only where a signal has more digits than a float these are not the values of `low_raw` and `high_raw`.
    """
    lowest, highest = sorted(raw * si_per_bit + si_offset for raw in (low_raw, high_raw))
    while lowest < highest and not holds(signal, (lowest - si_offset) / si_per_bit):
        lowest = math.nextafter(lowest, highest)
    while lowest < highest and not holds(signal, (highest - si_offset) / si_per_bit):
        highest = math.nextafter(highest, lowest)
    return lowest, highest


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
