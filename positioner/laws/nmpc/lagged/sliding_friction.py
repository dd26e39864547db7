"""The sliding friction F_c: its mean, and how much it differs from one slip to another. Pure.

A slip begins with the mean, known to a variance, and with the scatter of the slips. What readings and landing show of
its F_c moves the mean by the gain of a Kalman filter. The scatter is learned from how far a slip was from the mean: if
it is, on average, as far as expected, the scatter is right.
"""

from __future__ import annotations

from positioner.values import dataclass

_DRIFT = 0.1
"""From one slip to the next the mean wanders by a tenth of the scatter."""
_LEAST, _MOST = 0.01, 0.06
"""Limits of the scatter, as parts of the mean."""
_SCATTER_GAIN = 0.25
_FARTHEST2 = 25.0
"""A slip farther from the mean than 5 σ counts as one of 5 σ."""


@dataclass(frozen=True, slots=True)
class SlidingFriction:
    """F_c in N: its mean with a variance in N²; scatter2: variance of single slips, relative to the mean's square."""

    mean_n: float
    mean_n2: float
    scatter2: float

    @property
    def slip_n2(self) -> float:
        """Variance in N² of the F_c of the next slip."""
        return self.mean_n2 + self.scatter2 * self.mean_n * self.mean_n

    def after_slip(self, found_n: float, found_n2: float) -> SlidingFriction:
        """Return the friction after a slip whose F_c was found as `found_n`, with this variance left in N²."""
        before_n2 = self.slip_n2
        shown = min(max(1.0 - found_n2 / before_n2, 0.0), 1.0)
        away_n = found_n - self.mean_n
        away_n2 = min(away_n * away_n, _FARTHEST2 * shown * before_n2)
        mean2 = self.mean_n * self.mean_n
        scatter2 = self.scatter2 + _SCATTER_GAIN * (away_n2 - shown * before_n2) / mean2
        gain = self.mean_n2 / before_n2
        drift_n2 = _DRIFT * _DRIFT * self.scatter2 * mean2
        return SlidingFriction(
            self.mean_n + gain * away_n,
            self.mean_n2 * (1.0 - gain * shown) + drift_n2,
            min(max(scatter2, _LEAST * _LEAST), _MOST * _MOST),
        )


def sliding_friction(sliding_n: float, doubt: float, scatter: float) -> SlidingFriction:
    """Return what is believed before the first slip: F_c, its relative doubt, and the relative scatter of slips."""
    return SlidingFriction(sliding_n, doubt * doubt * sliding_n * sliding_n, scatter * scatter)
