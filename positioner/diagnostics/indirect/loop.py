"""The record of a control loop, and what the methods need of it: a stationary stretch at a suitable period. Pure."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAMPLES_PER_PERIOD = 28
"""Of the oscillation, after downsampling; between 25 and 30."""
_MOVES_OFTEN = 0.05
"""Of the samples: a setpoint that changes more often is another controller's output."""


@dataclass(frozen=True, slots=True)
class Loop:
    """Controller output, process value and setpoint at equal distances of period_s; sp is empty where there is none."""

    op: Array
    pv: Array
    sp: Array
    period_s: float

    @property
    def error(self) -> Array:
        """PV less its setpoint, or less its mean, without a trend."""
        return detrended(self.pv - self.sp if self.sp.size else self.pv)

    def part(self, begin: int, end: int) -> Loop:
        """Return the samples from `begin` to before `end`."""
        sp = self.sp[begin:end] if self.sp.size else self.sp
        return replace(self, op=self.op[begin:end], pv=self.pv[begin:end], sp=sp)

    def coarser(self, factor: int) -> Loop:
        """Return the means of `factor` samples each."""
        if factor <= 1:
            return self
        op, pv = block_means(self.op, factor), block_means(self.pv, factor)
        sp = block_means(self.sp, factor) if self.sp.size else self.sp
        return Loop(op, pv, sp, self.period_s * factor)


def block_means(values: Array, factor: int) -> Array:
    """Return the mean of each `factor` values; a rest at the end is left out."""
    whole = values[: values.size // factor * factor]
    return np.asarray(np.mean(whole.reshape(-1, factor), axis=1))


def detrended(values: Array) -> Array:
    """Return the values less their straight line."""
    time = np.linspace(-1.0, 1.0, values.size)
    slope, level = np.polyfit(time, values, 1)
    return np.asarray(values - level - slope * time)


def setpoint_changes(loop: Loop) -> Array:
    """Return the samples at which the setpoint steps; empty for one that stands still, or that always moves."""
    if not loop.sp.size:
        return np.zeros(0, dtype=np.float64)
    changes = np.flatnonzero(np.abs(np.diff(loop.sp)) > 1e-9 * max(1.0, float(np.max(np.abs(loop.sp))))) + 1
    return changes.astype(np.float64) if changes.size <= _MOVES_OFTEN * loop.sp.size else np.zeros(0, dtype=np.float64)


def steady(loop: Loop) -> NDArray[np.bool_]:
    """Return for each sample whether it lies outside the transient that follows a step of the setpoint.

    A transient ends when the error has come within twice the spread of the last third before the next step.
    """
    keep = np.ones(loop.op.size, dtype=np.bool_)
    borders = [*(int(each) for each in setpoint_changes(loop)), loop.op.size]
    for begin, end in pairwise(borders):
        error = loop.pv[begin:end] - loop.sp[begin:end]
        last = error[2 * error.size // 3 :]
        outside = np.flatnonzero(np.abs(error - float(np.median(last))) > 2.0 * float(np.std(last)))
        first = outside[outside < error.size // 2]
        keep[begin : begin + int(first[-1]) + 1 if first.size else begin] = False
    return keep


def range_of(values: Array) -> float:
    """Return how far the values go, without the outermost hundredth of them."""
    return float(np.quantile(values, 0.995) - np.quantile(values, 0.005))


def robust_sigma(values: Array) -> float:
    """Return the standard deviation by the median, which a few outliers do not change."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))
