"""Rounding a value to the steps of its signal, within its limits. Pure.

The step nearest to a value may be beyond a limit that the value itself keeps. A value that is sent is therefore rounded
to a step within its limits. A received value may be half a step beyond a limit, and then means the limit.
"""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from positioner.wire.fields import FieldFormat

_NOISE = 1e-6
"""Part of a step that arithmetic errors may add to a value exactly on a step, or exactly between two."""
_FLOATS = {16: ("<e", 2.0**-10), 32: ("<f", 2.0**-23), 64: ("<d", 2.0**-52)}
"""Format of struct and relative step of a floating-point signal, by its length in bits."""


def meant(form: FieldFormat, value: float, low: float, high: float) -> float | None:
    """Return the meaning of a received `value` within `low` and `high`: the limit where only rounding put it outside.

    None where it is outside by more than rounding.
    """
    if low <= value <= high:
        return value
    limit = low if value < low else high
    return limit if abs(value - limit) <= (0.5 + _NOISE) * _step(form, limit) else None


def inside(form: FieldFormat, value: float, low: float, high: float) -> float:
    """Return `value`, or the nearest step within `low` and `high` where the step nearest to `value` is outside.

    Where the signal has no step between them, `value` is returned as it is; `fits` reports that case at the start.
    """
    if form.float_bits:
        return _float_inside(form, value, low, high)
    raw = round((value - form.si_offset) / form.si_per_bit)
    step = raw * form.si_per_bit + form.si_offset
    if low <= step <= high and form.lowest <= step <= form.highest:
        return value
    first, last = _raw_limits(form, low, high)
    if first > last or first <= raw <= last:
        return value
    return min(max(raw, first), last) * form.si_per_bit + form.si_offset


def fits(form: FieldFormat, low: float, high: float) -> bool:
    """Return whether the signal has any step from `low` to `high`."""
    if form.float_bits:
        return max(low, form.lowest) <= min(high, form.highest)
    first, last = _raw_limits(form, low, high)
    return first <= last


def _raw_limits(form: FieldFormat, low: float, high: float) -> tuple[int, int]:
    """Return the lowest and highest raw value within `low` and `high` and the signal's range."""
    ends = (max(low, form.lowest), min(high, form.highest))
    bottom, top = sorted((end - form.si_offset) / form.si_per_bit for end in ends)
    if ends[0] > ends[1]:
        return 1, 0
    return math.ceil(bottom - _NOISE), math.floor(top + _NOISE)


def _float_inside(form: FieldFormat, value: float, low: float, high: float) -> float:
    layout, epsilon = _FLOATS[form.float_bits]
    for candidate in (value, value - epsilon * abs(value), value + epsilon * abs(value)):
        raw = (candidate - form.si_offset) / form.si_per_bit
        if low <= struct.unpack(layout, struct.pack(layout, raw))[0] * form.si_per_bit + form.si_offset <= high:
            return candidate
    return value


def _step(form: FieldFormat, value: float) -> float:
    """Return the distance between two neighbouring values of the signal near `value`, in the unit of the field."""
    if not form.float_bits:
        return abs(form.si_per_bit)
    return _FLOATS[form.float_bits][1] * max(abs(value - form.si_offset), abs(value))
