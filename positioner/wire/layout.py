"""Where the signals of a frame lie in its bytes: shifts and masks, computed once from the DBC. Pure.

The bytes of a frame are read as one number, the *word*: its low half is the little-endian number of the bytes. Its high
half is their big-endian number; it is there only where a signal of the frame is big-endian (Motorola). In its half each
signal is a row of neighbouring bits. cantools reads the same from the same DBC, and the tests compare the two.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from cantools.database.can.message import Message as DbcMessage
    from cantools.database.can.signal import Signal

_BYTE = 8
_FLOATS = {16: "<e", 32: "<f", 64: "<d"}
"""Format of struct of a floating-point signal, by its length in bits."""


@dataclass(frozen=True, slots=True)
class Place:
    """The bits of a signal: raw value = ((word >> shift & mask) ^ sign) - sign.

    `sign` is the value of the sign bit, 0 in an unsigned signal. `floating` is the format of struct of a floating-point
    signal, empty in others.
    """

    shift: int
    mask: int
    sign: int = 0
    floating: str = ""


NOWHERE = Place(0, 0)


def place_of(signal: Signal, length: int) -> Place:
    """Return where `signal` lies in the word of a frame of `length` bytes."""
    mask = (1 << signal.length) - 1
    sign = 1 << (signal.length - 1) if signal.is_signed and not signal.is_float else 0
    floating = _FLOATS[signal.length] if signal.is_float else ""
    if signal.byte_order == "little_endian":
        return Place(signal.start, mask, sign, floating)
    # a big-endian signal starts at its highest bit; bits are counted from the lowest one of each byte
    row, bit = divmod(signal.start, _BYTE)
    before = _BYTE * row + _BYTE - 1 - bit
    return Place(2 * _BYTE * length - before - signal.length, mask, sign, floating)


def is_mixed(dbc: DbcMessage) -> bool:
    """Return whether the word of this frame has its high half."""
    return any(signal.byte_order == "big_endian" for signal in dbc.signals)


def mixed_word(data: bytes) -> int:
    """Return the word with both halves."""
    return int.from_bytes(data, "big") << _BYTE * len(data) | int.from_bytes(data, "little")


def of_mixed_word(word: int, length: int) -> int:
    """Return the little-endian number of the bytes, from a word in which each signal is set in its own half only."""
    high = (word >> _BYTE * length).to_bytes(length, "big")
    return word & ((1 << _BYTE * length) - 1) | int.from_bytes(high, "little")


def start_word(dbc: DbcMessage, signals: Iterable[Signal]) -> int:
    """Return the word of `dbc` in which `signals` have their start values, 0 without one, and all other bits are 0."""
    word = 0
    for signal in signals:
        place, start = place_of(signal, dbc.length), signal.raw_initial or 0
        bits = bits_of(start, place.floating) if place.floating else round(start) & place.mask
        word |= bits << place.shift
    return word


def number_of(bits: int, floating: str) -> float:
    """Return the number in the `bits` of a floating-point signal."""
    number: float = struct.unpack(floating, bits.to_bytes(struct.calcsize(floating), "little"))[0]
    return number


def bits_of(number: float, floating: str) -> int:
    """Return the bits of a floating-point signal that holds `number`."""
    return int.from_bytes(struct.pack(floating, number), "little")
