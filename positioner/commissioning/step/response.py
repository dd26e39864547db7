"""The figures of one step response: dead time, T63, T86, T98, overshoot, travel gain. Pure.

Times begin with the step of the input, and are parts of the realised step, not of the wanted one (ISA-TR75.25.02). The
instant at which a level is crossed is that of an isotonic regression: there the sum of (level - reading) is largest.
It needs no model of the response, and no single reading decides it. A parabola through the readings around makes it
more exact.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from positioner.commissioning.readings import filled
from positioner.values import dataclass

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from positioner.commissioning.step.memory import Response

_PARTS = (0.632, 0.865, 0.98)
"""Of the realised step: T63, T86, T98."""
_NAN = math.nan
DEAD_TIME_SIGMA = 2.0
"""A motion counts for the dead time from so many σ of a reading on."""
_PASSED_SIGMA = 8.0
"""A level is passed for good once the readings beyond it outweigh so many σ; a later return does not count."""
_AROUND = 0.2
"""How far around a level the parabola reaches, as a part of the step."""
_RESTS_SIGMA, _RESTS_FOR, _FLAT_SIGMA, _BELOW_SIGMA = 4.0, 12, 3.0, 2.0
"""The rest of a stem just below a level: what counts for it, its shortest length, and how flat and how sure it is."""
_BEYOND = (32.0, 16.0, 8.0, 4.0)
"""How many times its level the parabola of the onset reaches, at most; less where it does not fit."""
Parabola: TypeAlias = tuple[float, float, float, float]
"""Its middle, and curve, slope and value there, by the numbers of samples."""
_FEWEST = 6
_MISFIT_SIGMA = 3.0
_CERTAIN_SIGMA = 5.0
"""Of a change of the mean, the largest of some thousand possible ones."""
_LONGEST_SEARCH = 4.0
"""A level is not told from the rest behind it where the noise leaves more samples than these open."""


@dataclass(frozen=True, slots=True)
class Figures:
    """The figures of a response; times in s, NaN where the stem did not move or the noise hides it.

    gain: realised step over asked step, both as parts of their ranges; overshoot: a part of the realised step.
    """

    size: float
    direction: float
    moved: bool
    gain: float
    dead_time_s: float
    t63_s: float
    t86_s: float
    t98_s: float
    overshoot: float


def figures_of(
    response: Response, period_s: float, sigma_m: float, seen_m: float, observable_m: float, span_m: float
) -> Figures:
    """Return the figures of a response; less than `seen_m` between two rests is no motion.

    observable_m: the smallest motion that ends the dead time.
    """
    step_m = response.direction * (response.final_m - response.before_m)
    gain = step_m / (response.size * span_m)
    if step_m <= seen_m:
        return Figures(response.size, response.direction, False, gain, _NAN, _NAN, _NAN, _NAN, _NAN)
    gone_m = response.direction * (filled(np.asarray(response.measured_m)) - response.before_m)
    t63_s, t86_s, t98_s = (
        instant(gone_m, part, step_m, sigma_m) * period_s if _resolved(part, step_m, sigma_m) else math.nan
        for part in _PARTS
    )
    dead_s = onset(gone_m, min(observable_m, _PARTS[0] * step_m), step_m, sigma_m) * period_s
    extreme_m = max(extreme(gone_m, sigma_m), step_m)
    return Figures(response.size, response.direction, True, gain, dead_s, t63_s, t86_s, t98_s, extreme_m / step_m - 1.0)


def _resolved(part: float, step_m: float, sigma_m: float) -> bool:
    """Return whether the noise lets a level be told from the final rest."""
    ratio = sigma_m / ((1.0 - part) * step_m)
    return ratio * ratio <= _LONGEST_SEARCH


def crossing(values: NDArray[np.float64], level: float, sigma: float) -> float:
    """Return the number of samples, with its fraction, after which `values` rise above `level`."""
    sums = np.cumsum(level - values)
    tops = np.maximum.accumulate(np.maximum(sums, 0.0))
    passed = np.flatnonzero(tops - sums > _PASSED_SIGMA * sigma)
    last = int(np.argmax(sums[: passed[0] + 1])) if len(passed) else int(np.argmax(sums))
    if sums[last] <= 0.0 or last + 1 == len(values):
        return float(last if sums[last] > 0.0 else 0)
    below, above = float(values[last]), float(values[last + 1])
    return last + min(max((level - below) / (above - below), 0.0), 1.0) if above > below else last + 0.5


def instant(values: NDArray[np.float64], part: float, step: float, sigma: float) -> float:
    """Return the number of samples, with its fraction, after which `values` pass this part of the step."""
    level = part * step
    middle = crossing(values, level, sigma)
    if rest := _rest_below(values, math.floor(middle), level, sigma):
        begin, mean = rest
        return begin + onset(values[begin:] - mean, level - mean, step, sigma)
    half = min(_AROUND, 0.9 * (1.0 - part)) * step
    before, after = crossing(values, level - half, sigma), crossing(values, level + half, sigma)
    # as far on both sides: a rest on one side is no part of the motion through the level
    reach = min(middle - before, after - middle)
    begin, end = max(math.ceil(middle - reach), 0), min(math.floor(middle + reach) + 1, len(values))
    found = _parabola(values, begin, end, sigma)  # none at a kink: the stem stuck, or was pushed again
    passed = math.nan if found is None else _rises_above(found, level)
    return passed if abs(passed - middle) <= reach else middle


def _rest_below(values: NDArray[np.float64], end: int, level: float, sigma: float) -> tuple[int, float] | None:
    """Return the begin of the rest just below a level that ends about there, and its mean; None where there is none."""
    begin = math.ceil(crossing(values[: max(end, 1)], level - _RESTS_SIGMA * sigma, sigma))
    count = end - begin
    if count < _RESTS_FOR or sigma == 0.0:
        return None
    times, mean = np.arange(count) - 0.5 * (count - 1), float(values[begin:end].mean())
    squares = float(times @ times)
    slope = float(times @ values[begin:end]) / squares
    rests = abs(slope) * math.sqrt(squares) < _FLAT_SIGMA * sigma
    # a rest that is no more certainly below than this leaves open when the stem passed
    below = _BELOW_SIGMA / math.sqrt(count) < (level - mean) / sigma < _BELOW_SIGMA
    return (begin, mean) if rests and below else None


def onset(values: NDArray[np.float64], level: float, step: float, sigma: float) -> float:
    """Return the number of samples, with its fraction, after which a stem that rested has moved by `level`.

    It begins at a kink, before which it rests. So a parabola from there on tells when it passes the level, as far as
    one fits; the few readings around the level alone would leave more than a sample open.
    """
    certain = max(level, min(DEAD_TIME_SIGMA * sigma, 0.5 * step))
    middle = crossing(values, certain, sigma)
    if sigma == 0.0:
        return middle
    first = max(min(math.ceil(crossing(values, 0.5 * certain, sigma)), math.ceil(middle) - 1), 0)
    for times in _BEYOND:
        end = math.floor(crossing(values, min(times * certain, 0.5 * step), sigma)) + 1
        if (found := _parabola(values, first, end, sigma)) is None:
            continue
        kink = _rises_above(found, 0.0)
        begin = first if math.isnan(kink) else min(max(math.ceil(kink), 0), math.floor(middle))
        if (found := _parabola(values, begin, end, sigma)) is None:
            continue
        passed = _rises_above(found, level)
        if abs(passed - middle) <= max(end - middle, float(_FEWEST)):
            return max(passed, 0.0)
    return middle


def _parabola(values: NDArray[np.float64], begin: int, end: int, sigma: float) -> Parabola | None:
    """Return the parabola through these samples; None where they are too few, or it does not fit."""
    count = end - begin
    if sigma == 0.0 or count < _FEWEST:
        return None
    times, middle = np.arange(count) - 0.5 * count, begin + 0.5 * count
    curve, slope, off = (float(each) for each in np.polyfit(times, values[begin:end], 2))
    misfit = values[begin:end] - (curve * times + slope) * times - off
    free = count - 3
    if float(misfit @ misfit) > sigma * sigma * (free + _MISFIT_SIGMA * math.sqrt(2.0 * free)):
        return None
    return middle, curve, slope, off


def _rises_above(parabola: Parabola, level: float) -> float:
    """Return where a parabola rises through a level, NaN where it does not."""
    middle, curve, slope, off = parabola
    root = slope * slope - 4.0 * curve * (off - level)
    if root < 0.0 or (slope <= 0.0 and curve == 0.0):
        return math.nan
    steep = math.sqrt(root)  # the slope there
    return middle + (2.0 * (level - off) / (slope + steep) if slope > 0.0 else (steep - slope) / (2.0 * curve))


def extreme(values: NDArray[np.float64], sigma: float) -> float:
    """Return the largest value behind the noise: the largest mean of the stretches between certain changes.

    A stem that sticks makes rests, and the mean of each is exact. Without noise it is the largest value.
    """
    if sigma == 0.0:
        return float(values.max())
    sums = np.concatenate(([0.0], np.cumsum(values)))
    largest, parts = -math.inf, [(0, len(values))]
    while parts:
        begin, end = parts.pop()
        count = end - begin
        mean = (sums[end] - sums[begin]) / count
        lengths = np.arange(1, count)
        away = sums[begin + 1 : end] - sums[begin] - lengths * mean
        certain = np.abs(away) * np.sqrt(count / (lengths * (count - lengths)))
        split = int(np.argmax(certain)) + 1 if count > 1 else 0
        if split and certain[split - 1] > _CERTAIN_SIGMA * sigma:
            parts += [(begin, begin + split), (begin + split, end)]
        else:
            largest = max(largest, float(mean))
    return largest
