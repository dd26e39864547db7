"""The resolution of the position sensor, by the steps that its readings have made, and what it hides. Pure.

The readings of a quantised sensor differ by whole multiples of one step q, those of any other sensor do not. A stem at
rest gives one reading again and again: its average stays off by up to q/2 (variance q²/12), however many readings it
has. Noise of σ moves the readings across the steps and leaves a fraction e^(-4π²σ²/q²) of that variance (the first
harmonic of the error of a quantiser with Gaussian dither; Widrow and Kollár, Quantization Noise, 2008).
"""

from __future__ import annotations

import math

from positioner.values import dataclass

_SURE = 2
"""So many changes in a row that are multiples of the step make a quantised sensor."""
_ROUNDING_M = 5e-6
"""Changes of the reading are equal within this: readings are rounded by the frame, too."""
_FINEST_M = 2e-5
"""A finer step is none: it hides nothing that matters."""


@dataclass(frozen=True, slots=True)
class Resolution:
    """The last reading in m, the step in m, and how many changes since it was found were multiples of it.

    The step is the greatest common divisor of all changes of the reading. That of a sensor which is not quantised is
    none after two or three changes.
    """

    last_m: float | None = None
    step_m: float = math.inf
    multiples: int = 0

    def followed_by(self, measured_m: float) -> Resolution:
        """Return what is known after one more reading."""
        if self.last_m is None:
            return Resolution(measured_m)
        if self.step_m < _FINEST_M or measured_m == self.last_m:
            return self
        change_m, step_m = abs(measured_m - self.last_m), self.step_m
        if step_m == math.inf:
            return Resolution(measured_m, change_m)
        rest_m = _rest_m(change_m, step_m)
        if rest_m < _ROUNDING_M:
            return Resolution(measured_m, step_m, self.multiples + 1)
        while rest_m >= _ROUNDING_M:
            step_m, rest_m = rest_m, _rest_m(step_m, rest_m)
        return Resolution(measured_m, step_m)

    def hidden_m2(self, noise_m2: float) -> float:
        """Return the variance in m² of what no average at rest can show, under white noise of that variance."""
        if self.multiples < _SURE:
            return 0.0
        step_m2 = self.step_m * self.step_m
        return step_m2 / 12.0 * math.exp(-4.0 * math.pi * math.pi * noise_m2 / step_m2)


def _rest_m(whole_m: float, part_m: float) -> float:
    """Return how far in m the whole is from a multiple of the part."""
    return abs(whole_m - math.floor(whole_m / part_m + 0.5) * part_m)
