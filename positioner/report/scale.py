"""The scale of an axis: round numbers as ticks, and where a value lies. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

_BEYOND = 0.03
"""A value that lies beyond a tick by less than this part of a step needs no other tick: the scale ends with it."""
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True, slots=True)
class Scale:
    """Values from `low` to `high` on a line from `begin` to `end`, with a tick every `step`."""

    low: float
    high: float
    begin: float
    end: float
    step: float

    def at(self, value: float) -> float:
        """Return the place of a value."""
        return self.begin + (self.end - self.begin) * (value - self.low) / (self.high - self.low)

    @property
    def ticks(self) -> tuple[float, ...]:
        """The round numbers on the scale."""
        first = math.ceil(self.low / self.step - 1e-9)
        last = math.floor(self.high / self.step + 1e-9)
        return tuple(number * self.step for number in range(first, last + 1))

    def label(self, tick: float) -> str:
        """Return the number at a tick, with as many decimals as the step needs."""
        decimals = max(0, -math.floor(math.log10(self.step) + 1e-9))
        if abs(round(self.step, decimals) - self.step) > 1e-9 * self.step:  # steps of 2.5
            decimals += 1
        text = f"{abs(tick):,.{decimals}f}".replace(",", "\N{NARROW NO-BREAK SPACE}")
        return f"\N{MINUS SIGN}{text}" if tick < -0.5 * 10.0**-decimals else text


def scale(
    values: Iterable[float], begin: float, end: float, ticks: int, *, from_zero: bool = False, tight: bool = False
) -> Scale:
    """Return a scale that holds all values, with about as many ticks; it ends at ticks, or `tight` at the values."""
    finite = [each for each in values if math.isfinite(each)]
    low, high = (min(finite), max(finite)) if finite else (0.0, 1.0)
    if from_zero:
        low, high = min(low, 0.0), max(high, 0.0)
    if high - low <= 1e-12 * max(abs(low), abs(high), 1e-12):
        half = 0.5 * abs(low) or 0.5
        low, high = (low - half, high + half) if not from_zero else (low, high or 1.0)
    step = _round_step((high - low) / max(ticks, 1))
    if tight:
        return Scale(low, high, begin, end, step)
    first, last = math.floor(low / step + _BEYOND) * step, math.ceil(high / step - _BEYOND) * step
    return Scale(min(first, low), max(last, high), begin, end, step)


def _round_step(least: float) -> float:
    unit = 10.0 ** math.floor(math.log10(least))
    return next(each * unit for each in _STEPS if each * unit >= least * (1.0 - 1e-9))
