"""How much the sliding friction F_c differs from one slip to another. Pure.

The mean of F_c is in the regression. The scatter is learned from how far a slip was from the mean: if it is, on
average, as far as expected, the scatter is right.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.regression import OnsetRegression

_DRIFT = 0.1
"""From one slip to the next the mean wanders by a tenth of the scatter."""
_LEAST, _MOST = 0.01, 0.06
"""Limits of the scatter, as parts of the mean."""
_SCATTER_GAIN = 0.25
_FARTHEST2 = 25.0
"""A slip farther from the mean than 5 σ counts as one of 5 σ."""


def after_slip(
    known: OnsetRegression, scatter2: float, x: float, direction: float, found_n: float, found_n2: float
) -> tuple[OnsetRegression, float]:
    """Return the regression and the scatter after a slip at x whose F_c was found, with this variance left in N².

    scatter2: variance of single slips, relative to the square of the mean.
    """
    before_n2, mean2 = known.slip_n2(x, direction, scatter2), known.sliding_n * known.sliding_n
    shown = min(max(1.0 - found_n2 / before_n2, 0.0), 1.0)
    away_n = found_n - known.sliding_n
    away_n2 = min(away_n * away_n, _FARTHEST2 * shown * before_n2)
    changed2 = scatter2 + _SCATTER_GAIN * (away_n2 - shown * before_n2) / mean2
    after = known.with_slip(x, direction, scatter2, found_n, found_n2)
    after = replace(after, cc=after.cc + _DRIFT * _DRIFT * scatter2 * mean2)
    return after, min(max(changed2, _LEAST * _LEAST), _MOST * _MOST)
