"""The usual mistakes in computing a CRC: which of them gives the CRC of a frame. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.wire import e2e

if TYPE_CHECKING:
    from collections.abc import Iterator

_POLYNOMIAL = 0x1021
_START = 0xFFFF


def mistake(data: bytes, data_id: int, id_offset: int) -> str:
    """Return what is wrong with the CRC in the first two bytes of `data`; empty where it is no usual mistake."""
    stored = int.from_bytes(data[:2], "little")
    return next((text for text, value in _mistakes(data[2:], data_id, id_offset) if value == stored), "")


def _mistakes(covered: bytes, data_id: int, id_offset: int) -> Iterator[tuple[str, int]]:
    low, high = data_id.to_bytes(2, "little")
    with_id = covered + bytes([low, high])
    right = e2e.crc(covered, data_id)
    yield "its two bytes are swapped: the low byte comes first", (right & 0xFF) << 8 | right >> 8
    yield "it does not cover the data ID", _crc(covered)
    yield "it covers the data ID high byte first", _crc(covered + bytes([high, low]))
    yield "it covers the data ID before the frame's bytes", _crc(bytes([low, high]) + covered)
    if id_offset:
        yield "id_offset is missing from the data ID", e2e.crc(covered, data_id - id_offset)
    yield "it starts at 0 instead of FFFF", _crc(with_id, start=0)
    yield "it is inverted at the end", right ^ 0xFFFF
    yield "it is reflected (CRC-16/MCRF4XX)", _reflected(with_id)
    yield "it is reflected and inverted (CRC-16/X-25)", _reflected(with_id) ^ 0xFFFF
    yield "it covers its own place, as two bytes of 0", _crc(bytes(2) + with_id)
    yield "there is none: both its bytes are 0", 0


def _crc(covered: bytes, start: int = _START) -> int:
    value = start
    for byte in covered:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ _POLYNOMIAL if value & 0x8000 else value << 1) & 0xFFFF
    return value


def _reflected(covered: bytes) -> int:
    value = _START
    for byte in covered:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0x8408 if value & 1 else value >> 1
    return value
