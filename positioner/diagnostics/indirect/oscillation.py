"""The oscillation of a signal: its period, how regular it is, and its half cycles. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from positioner.diagnostics.indirect.loop import detrended

Array = NDArray[np.float64]

_SHORTEST = 8.0
"""Samples of the shortest period that is looked for."""
_LEAST_PERIODS = 4.0
_SMOOTHED = 12.0
"""A half cycle is read from the mean over a twelfth of the period."""
_HALF_LEAST, _HALF_MOST = 0.15, 1.5
"""Of the period: a shorter or longer half cycle is none."""
_REGULAR = 3.0


@dataclass(frozen=True, slots=True)
class Oscillation:
    """period: in samples; regularity: (mean/deviation)/3 of the periods, above 1 where it is regular (Thornhill)."""

    period: float
    regularity: float


def oscillation_of(signal: Array) -> Oscillation:
    """Return the strongest oscillation: the peak of the spectrum, refined by the half cycles."""
    count = signal.size
    power = np.abs(np.fft.rfft(detrended(signal) * np.hanning(count), 4 * count)) ** 2
    frequency = np.fft.rfftfreq(4 * count)
    usable = (frequency >= _LEAST_PERIODS / count) & (frequency <= 1.0 / _SHORTEST)
    if not np.any(usable):
        return Oscillation(float(count) / _LEAST_PERIODS, 0.0)
    peak = float(frequency[usable][int(np.argmax(power[usable]))])
    period = 1.0 / peak
    crossings = rising_crossings(signal, period)
    if crossings.size < 4:  # noqa: PLR2004 - three periods
        return Oscillation(period, 0.0)
    lengths = np.diff(crossings)
    spread = float(np.std(lengths))
    return Oscillation(period, float(np.mean(lengths)) / (_REGULAR * spread) if spread > 0.0 else np.inf)


def smoothed(signal: Array, width: int) -> Array:
    """Return the running mean over `width` samples, an odd number."""
    if width <= 1:
        return signal
    width += 1 - width % 2
    padded = np.pad(signal, width // 2, mode="edge")
    return np.asarray(np.convolve(padded, np.full(width, 1.0 / width), mode="valid"))


def centred(signal: Array, period: float) -> Array:
    """Return the signal less its mean over one and a half periods about each sample, which follows slow changes."""
    width = min(round(1.5 * period), signal.size // 2)
    width -= width % 2
    ends = np.cumsum(np.concatenate([[0.0], signal]))
    begin = np.maximum(np.arange(signal.size) - width // 2, 0)
    end = np.minimum(np.arange(signal.size) + width // 2 + 1, signal.size)
    return np.asarray(signal - (ends[end] - ends[begin]) / (end - begin))


def rising_crossings(signal: Array, period: float) -> Array:
    """Return where the smoothed signal crosses its slow mean upwards, by linear interpolation, in samples."""
    off = smoothed(centred(signal, period), round(period / _SMOOTHED))
    at = np.flatnonzero((off[:-1] < 0.0) & (off[1:] >= 0.0))
    return np.asarray(at + off[at] / (off[at] - off[at + 1]))


def half_cycles(signal: Array, period: float) -> list[Array]:
    """Return the samples of each half cycle, as positive values about its zero crossings."""
    off = centred(signal, period)
    smooth = smoothed(off, round(period / _SMOOTHED))
    signs = np.where(smooth >= 0.0, 1.0, -1.0)
    borders = np.flatnonzero(np.diff(signs)) + 1
    found = []
    for begin, end in pairwise(borders.tolist()):
        if _HALF_LEAST * period <= end - begin <= _HALF_MOST * period and end - begin >= 4:  # noqa: PLR2004
            found.append(np.asarray(off[begin:end] * signs[begin]))
    return found
