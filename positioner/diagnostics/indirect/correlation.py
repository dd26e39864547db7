"""Horch (1999): the cross-correlation of OP and PV is odd where the valve sticks, else even. Pure.

A. Horch, A simple method for detection of stiction in control valves, Control Engineering Practice 7, 1221-1231. For
self-regulating processes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from positioner.diagnostics.indirect.method import Answer
from positioner.diagnostics.indirect.oscillation import centred

Array = NDArray[np.float64]

NAME, SOURCE = "CORR", "Horch 1999"
_YES, _NO = 1.0 / 3.0, (2.0 - math.sqrt(3.0)) / (2.0 + math.sqrt(3.0))
"""Of Δρ: the values for phase shifts of 90° ± 30° and of 180° ± 30°."""
_YES_LAG, _NO_LAG = 2.0 / 3.0, 1.0 / 3.0
"""Of Δτ."""


def correlation(op: Array, pv: Array, period: float) -> Answer:
    """Return Δρ; where Δτ contradicts it, the index is NaN."""
    reach = min(round(period), op.size // 2 - 1)
    first, second = centred(op, period), centred(pv, period)
    scale = math.sqrt(float(first @ first) * float(second @ second))
    if scale <= 0.0 or reach < 2:  # noqa: PLR2004
        return Answer(NAME, SOURCE, math.nan, _YES, _NO, "nothing oscillates")
    lags = np.arange(-reach, reach + 1)
    value = np.array([_product(first, second, int(lag)) for lag in lags]) / scale
    right = next((k for k in range(reach) if value[reach + k] * value[reach + k + 1] <= 0.0), None)
    left = next((k for k in range(reach) if value[reach - k] * value[reach - k - 1] <= 0.0), None)
    if right is None or left is None:
        return Answer(NAME, SOURCE, math.nan, _YES, _NO, "no zero crossing within a period")
    after = right + _part(value[reach + right], value[reach + right + 1])
    before = left + _part(value[reach - left], value[reach - left - 1])
    lag_measure = abs(before - after) / (before + after) if before + after > 0.0 else 1.0
    at_zero = abs(float(value[reach]))
    best = float(np.max(np.abs(value[reach - left - 1 : reach + right + 2])))
    if before + after < 0.25 * period:  # the zero crossing is at lag 0: the nearest extreme is the optimum
        best = float(np.max(np.abs(value[reach - round(period / 2) : reach + round(period / 2) + 1])))
    size_measure = abs(at_zero - best) / (at_zero + best)
    says_yes, says_no = size_measure > _YES, size_measure < _NO
    if (says_yes and lag_measure < _NO_LAG) or (says_no and lag_measure > _YES_LAG):
        return Answer(NAME, SOURCE, math.nan, _YES, _NO, f"Δρ {size_measure:.2f} and Δτ {lag_measure:.2f} disagree")
    return Answer(NAME, SOURCE, size_measure, _YES, _NO, f"Δτ {lag_measure:.2f}")


def _product(first: Array, second: Array, lag: int) -> float:
    if lag >= 0:
        return float(first[: first.size - lag] @ second[lag:])
    return float(first[-lag:] @ second[: second.size + lag])


def _part(here: float, there: float) -> float:
    return float(here / (here - there)) if here != there else 0.0
