"""What a signal of a DBC can carry: whole numbers or fractions, and their range. Pure."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from positioner.errors import PositionerError, shortened

if TYPE_CHECKING:
    from cantools.database.can.signal import Signal

_MOST_BITS = 64
_LARGEST_FLOAT = {16: 65504.0, 32: 3.4028234e38, 64: sys.float_info.max}
"""Largest finite value of a floating-point signal, by its length in bits."""


class UnfitSignalError(PositionerError):
    """A signal that cannot carry a field, with the reason."""


def counter_modulus(signal: Signal) -> int:
    """Return how many values a counter in `signal` has, from 0 on: its range in the DBC, or all that its bits allow."""
    return int(raw_range(signal)[1]) + 1


def is_plain_integer(signal: Signal) -> bool:
    """Return whether the raw value of `signal` is its meaning: no scale, no offset, no fraction."""
    return not signal.is_float and signal.scale == 1 and signal.offset == 0


def check_numbers(signal: Signal) -> None:
    """Raise UnfitSignalError where a signal's scale, offset, range or length can carry no number."""
    if not signal.is_float and signal.length > _MOST_BITS:
        raise UnfitSignalError(f"has {signal.length} bits, and there are {_MOST_BITS} in a frame")
    if signal.is_float and signal.length not in _LARGEST_FLOAT:
        raise UnfitSignalError(f"is a floating-point signal of {signal.length} bits, and there are 16, 32 and 64")
    numbers = {"scale": signal.scale, "offset": signal.offset, "minimum": signal.minimum, "maximum": signal.maximum}
    for name, value in numbers.items():
        if value is not None and not abs(value) <= sys.float_info.max:
            raise UnfitSignalError(f"has the {name} {shortened(str(value))}, which is no number that a signal can have")
    if signal.scale == 0:
        raise UnfitSignalError("has the scale 0, which carries no number")


def holds(signal: Signal, raw: float) -> bool:
    """Return whether the bits of `signal` hold the number `raw`, an integer after rounding."""
    if signal.is_float:
        return abs(raw) <= _LARGEST_FLOAT[signal.length]
    half = 1 << (signal.length - 1)
    return -half <= round(raw) < half if signal.is_signed else 0 <= round(raw) < 2 * half


def raw_range(signal: Signal) -> tuple[float, float]:
    """Return the lowest and highest raw value that the signal's length and its range in the DBC, if any, allow."""
    if signal.is_float:
        low, high = -_LARGEST_FLOAT[signal.length], _LARGEST_FLOAT[signal.length]
    elif signal.is_signed:
        low, high = -(2.0 ** (signal.length - 1)), 2.0 ** (signal.length - 1) - 1.0
    else:
        low, high = 0.0, 2.0**signal.length - 1.0
    ends = (signal.minimum, signal.maximum)
    limits = [None if end is None else (float(end) - float(signal.offset)) / float(signal.scale) for end in ends]
    lower, upper = limits if signal.scale > 0 else reversed(limits)
    return low if lower is None else max(low, lower), high if upper is None else min(high, upper)
