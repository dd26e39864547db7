"""End-to-end protection of 8-byte frames, AUTOSAR E2E profile 5: CRC-16 and counter. Pure.

Source: AUTOSAR FO R22-11 "E2E Protocol Specification", profile 5. The CRC covers bytes 2..7 and then the 16-bit data
ID, low byte first. The data ID is never sent, so that a frame of another kind does not pass. The minimum Hamming
distance over the frame is 4. Bursts of up to 15 bits are detected; of 16 bits all but six patterns, which reach from
the CRC, the first field, into the counter. The profile detects damage; `CounterCheck` and the guard detect replay and
age.
"""

from __future__ import annotations

import binascii
from enum import Enum

from positioner.values import dataclass

COUNTER_MODULUS = 256
MAX_LOST_FRAMES = 10
"""Frames that may be missing between two accepted ones; a larger step must be confirmed (see `CounterCheck`)."""
MAX_LATE_FRAMES = 3
"""A missing frame may come so many counts late: others have overtaken it."""

_CRC_START = 0xFFFF
_LATE_BITS = (1 << MAX_LATE_FRAMES) - 1


def crc(protected: bytes, data_id: int) -> int:
    """Return the 16-bit profile 5 CRC of `protected` (all bytes behind the CRC field) and the data ID."""
    return binascii.crc_hqx(protected + data_id.to_bytes(2, "little"), _CRC_START)


def protect(payload: bytes, data_id: int) -> bytes:
    """Return `payload` with its first two bytes replaced by the CRC, low byte first."""
    return crc(payload[2:], data_id).to_bytes(2, "little") + payload[2:]


def is_intact(data: bytes, data_id: int) -> bool:
    """Return whether the CRC in the first two bytes of `data` fits the rest of it."""
    return data[:2] == crc(data[2:], data_id).to_bytes(2, "little")


class Sequence(Enum):
    """Result of the check of a counter."""

    FRESH = "fresh"
    REPEATED = "repeated"
    LATE = "late"
    OUT_OF_ORDER = "out of order"


@dataclass(frozen=True, slots=True)
class CounterCheck:
    """Checks one sender's counter.

    Steps of 1 to `MAX_LOST_FRAMES` + 1 are fresh (the step less one is the number of lost frames). A step of 0 is a
    repetition. A frame that was missing among the last `MAX_LATE_FRAMES` counts is late: others have overtaken it on
    the bus. Any other step is out of order, unless the frame before was out of order, too, and this one follows it
    directly: then the sender has restarted, and its new count is accepted.

    missing: bit k is set while the frame of count `last` - 1 - k has not come.
    """

    last: int | None = None
    candidate: int | None = None
    modulus: int = COUNTER_MODULUS
    missing: int = 0

    def check(self, counter: int) -> tuple[CounterCheck, Sequence, int]:
        """Return the check after `counter`, the result, and how many frames were lost before it."""
        if self.last is None:
            return self._at(counter), Sequence.FRESH, 0
        step = (counter - self.last) % self.modulus
        if step == 0:
            return self._at(counter, self.missing), Sequence.REPEATED, 0
        if step <= MAX_LOST_FRAMES + 1:
            skipped = (1 << (step - 1)) - 1
            return self._at(counter, (self.missing << step | skipped) & _LATE_BITS), Sequence.FRESH, step - 1
        overtaken = 1 << (self.modulus - step - 1)
        if self.missing & overtaken:
            return self._at(self.last, self.missing & ~overtaken), Sequence.LATE, 0
        if self.candidate is not None and (counter - self.candidate) % self.modulus == 1:
            return self._at(counter), Sequence.FRESH, 0
        return CounterCheck(self.last, counter, self.modulus, self.missing), Sequence.OUT_OF_ORDER, 0

    def _at(self, counter: int, missing: int = 0) -> CounterCheck:
        return CounterCheck(counter, None, self.modulus, missing)
