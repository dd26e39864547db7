"""The meaning of a loop current by NAMUR recommendation NE 43. Pure.

3.8 to 20.5 mA is a measured or commanded value. 3.6 mA and below, and 21 mA and above, are failure signals: the sender
reports that it has failed. Currents in between have no meaning and are never sent.
"""

from __future__ import annotations

from enum import Enum

FAILURE_LOW_MA = 3.6
VALUE_LOW_MA = 3.8
VALUE_HIGH_MA = 20.5
FAILURE_HIGH_MA = 21.0
LARGEST_MA = 22.0
"""The largest current that is ever asked for."""


class LoopSignal(Enum):
    """The meaning of a current by NE 43."""

    VALUE = "value"
    FAILURE = "failure signal"
    NEITHER = "neither value nor failure signal"


def signal_of(current_ma: float) -> LoopSignal:
    """Return the meaning of `current_ma`; not-a-number is a failure."""
    if VALUE_LOW_MA <= current_ma <= VALUE_HIGH_MA:
        return LoopSignal.VALUE
    return LoopSignal.NEITHER if FAILURE_LOW_MA < current_ma < FAILURE_HIGH_MA else LoopSignal.FAILURE


def same_signal(current_ma: float) -> tuple[float, float]:
    """Return the lowest and highest current in mA of the same meaning as `current_ma`, a value or a failure signal."""
    if signal_of(current_ma) is LoopSignal.VALUE:
        return VALUE_LOW_MA, VALUE_HIGH_MA
    is_low = current_ma < VALUE_LOW_MA  # pragma: no mutate - a current of exactly VALUE_LOW_MA is a value
    return (0.0, FAILURE_LOW_MA) if is_low else (FAILURE_HIGH_MA, LARGEST_MA)
