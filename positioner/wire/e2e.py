"""End-to-end protection of 8-byte frames: AUTOSAR E2E profile 5 (CRC-16 and counter), and what a counter may do. Pure.

Source: AUTOSAR FO R22-11 "E2E Protocol Specification", profile 5. The CRC covers bytes 2..7 and then the 16-bit data
ID, low byte first, which is never sent: a frame of another kind does not pass. Minimum Hamming distance 4 over the
frame; bursts of up to 15 bits are detected, and of 16 bits all but six patterns that reach from the CRC, which stands
first, into the counter. The profile detects damage; replay and age are caught by `CounterCheck` and by the guard.
"""

from __future__ import annotations

import binascii
from dataclasses import dataclass
from enum import Enum

COUNTER_MODULUS = 256
MAX_LOST_FRAMES = 10
"""Frames that may be missing between two accepted ones; a larger step must be confirmed (see `CounterCheck`)."""

_CRC_START = 0xFFFF


def crc(protected: bytes, data_id: int) -> int:
    """Return the 16-bit profile 5 CRC of `protected` (all bytes behind the CRC field) and the data ID."""
    return binascii.crc_hqx(protected + data_id.to_bytes(2, "little"), _CRC_START)


def protect(payload: bytes, data_id: int) -> bytes:
    """Return `payload` with its first two bytes replaced by the CRC, low byte first."""
    return crc(payload[2:], data_id).to_bytes(2, "little") + payload[2:]


def is_intact(data: bytes, data_id: int) -> bool:
    """Return whether the CRC in the first two bytes of `data` fits the rest of it."""
    return int.from_bytes(data[:2], "little") == crc(data[2:], data_id)


class Sequence(Enum):
    """Verdict on a counter."""

    FRESH = "fresh"
    REPEATED = "repeated"
    OUT_OF_ORDER = "out of order"


@dataclass(frozen=True, slots=True)
class CounterCheck:
    """Follows one sender's counter.

    Steps of 1 to `MAX_LOST_FRAMES` + 1 are fresh (the step less one is the number of lost frames). A step of 0 is a
    repetition. Any other step is out of order, unless the frame before was rejected for the same reason and this one
    follows it directly: then the sender has restarted, and its new count is taken over.
    """

    last: int | None = None
    candidate: int | None = None
    modulus: int = COUNTER_MODULUS

    def check(self, counter: int) -> tuple[CounterCheck, Sequence, int]:
        """Return the check after `counter`, the verdict, and how many frames were lost before it."""
        if self.last is None:
            return self._at(counter), Sequence.FRESH, 0
        step = (counter - self.last) % self.modulus
        if step == 0:
            return self._at(counter), Sequence.REPEATED, 0
        if step <= MAX_LOST_FRAMES + 1:
            return self._at(counter), Sequence.FRESH, step - 1
        if self.candidate is not None and (counter - self.candidate) % self.modulus == 1:
            return self._at(counter), Sequence.FRESH, 0
        return CounterCheck(self.last, counter, self.modulus), Sequence.OUT_OF_ORDER, 0

    def _at(self, counter: int) -> CounterCheck:
        return CounterCheck(counter, None, self.modulus)
