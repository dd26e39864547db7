"""What a loop current says by itself: NAMUR recommendation NE 43. Pure.

3.8 to 20.5 mA is a measured or commanded value. At 3.6 mA and below, and at 21 mA and above, the current is no value:
it says that its sender has failed. What lies between belongs to neither and is left to nobody.
"""

from __future__ import annotations

from enum import Enum

FAILURE_LOW_MA = 3.6
VALUE_LOW_MA = 3.8
VALUE_HIGH_MA = 20.5
FAILURE_HIGH_MA = 21.0
LARGEST_MA = 22.0
"""No loop is asked for more, failed or not."""


class LoopSignal(Enum):
    """What a current is, by NE 43."""

    VALUE = "value"
    FAILURE = "failure signal"
    NEITHER = "neither value nor failure signal"


def signal_of(current_ma: float) -> LoopSignal:
    """Return what `current_ma` says; what is no number is a failure."""
    if VALUE_LOW_MA <= current_ma <= VALUE_HIGH_MA:
        return LoopSignal.VALUE
    return LoopSignal.NEITHER if FAILURE_LOW_MA < current_ma < FAILURE_HIGH_MA else LoopSignal.FAILURE


def same_signal(current_ma: float) -> tuple[float, float]:
    """Return the lowest and highest current in mA that says the same as `current_ma`, a value or a failure signal."""
    if signal_of(current_ma) is LoopSignal.VALUE:
        return VALUE_LOW_MA, VALUE_HIGH_MA
    return (0.0, FAILURE_LOW_MA) if current_ma < VALUE_LOW_MA else (FAILURE_HIGH_MA, LARGEST_MA)
