"""The resolution of the position sensor, by the steps that its readings have made, and what it hides. Pure.

The readings of a quantised sensor differ by whole multiples of one step q, those of any other sensor do not. A stem at
rest gives one reading again and again: its average stays off by up to q/2 (variance q²/12), however many readings it
has. Noise of σ moves the readings across the steps and leaves a fraction e^(-4π²σ²/q²) of that variance (the first
harmonic of the error of a quantiser with Gaussian dither; Widrow and Kollár, Quantization Noise, 2008).
"""

from __future__ import annotations

import math

from positioner.values import dataclass

_SURE = 4
"""So many different steps in a row that are multiples of the smallest one make a quantised sensor."""
_WHOLE = 0.02
"""A ratio of two steps is a whole number within this."""
_LARGEST_RATIO = 30.0
"""Larger ratios are not looked at: the readings are rounded by the frame, too."""


@dataclass(frozen=True, slots=True)
class Resolution:
    """The last reading in m, the smallest step between two readings in m, and how many steps were multiples of it."""

    last_m: float | None = None
    step_m: float = math.inf
    multiples: int = 0

    def followed_by(self, measured_m: float) -> Resolution:
        """Return what is known after one more reading."""
        if self.last_m is None:
            return Resolution(measured_m)
        change_m = abs(measured_m - self.last_m)
        if change_m == 0.0:
            return self
        step_m, multiples = self.step_m, self.multiples
        if change_m < step_m * (1.0 - _WHOLE):
            return Resolution(measured_m, change_m)
        ratio = change_m / step_m
        if ratio > _LARGEST_RATIO:
            return Resolution(measured_m, step_m, multiples)
        is_whole = abs(ratio - math.floor(ratio + 0.5)) < _WHOLE
        return Resolution(measured_m, step_m, multiples + 1 if is_whole else 0)

    def hidden_m2(self, noise_m2: float) -> float:
        """Return the variance in m² of what no average at rest can show, under white noise of that variance."""
        if self.multiples < _SURE:
            return 0.0
        step_m2 = self.step_m * self.step_m
        return step_m2 / 12.0 * math.exp(-4.0 * math.pi * math.pi * noise_m2 / step_m2)
