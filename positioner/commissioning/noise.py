"""The noise of the position sensor, from the readings of an experiment. Pure.

The scatter is taken from second differences, which a smooth motion does not change, so that strokes show it at every
place. Noise that is held or correlated has smaller differences; the scatter at rest gives the right size then.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from positioner.commissioning.record import Kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.commissioning.record import Stretch

_BLOCK = 200
_CERTAIN = 4.0
_Z = 1.96


@dataclass(frozen=True, slots=True)
class Noise:
    """σ of a reading at x: of_reading·x + of_span_m, in m; error: the relative standard error of this σ.

    correlation: the scatter at rest over that of the differences; 1 for white noise.
    """

    of_reading: float
    of_span_m: float
    error: float
    correlation: float

    def sigma_m(self, position_m: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Return σ in m at a position in m."""
        return np.asarray(self.of_reading * np.abs(position_m) + self.of_span_m)


def noise_of(stretches: Sequence[Stretch]) -> Noise:
    """Return the noise of the readings in `stretches`, by weighted least squares over blocks."""
    places: list[float] = []
    scatters: list[float] = []
    ratios: list[float] = []
    for each in stretches:
        readings = np.asarray(each.measured_m)
        if each.kind is not Kind.STROKE:
            readings = readings[: each.held or len(readings)]
            readings = readings[len(readings) // 4 :]
            direct = _scatter_m(readings)
            if direct > 0.0 and len(readings) >= _BLOCK // 4:
                ratios.append(float(np.nanstd(readings, ddof=1)) / direct)
        for begin in range(0, max(len(readings) - _BLOCK // 2, 1), _BLOCK):
            block = readings[begin : begin + _BLOCK]
            if len(block) >= min(_BLOCK // 2, len(readings)) and not np.isnan(block).all():
                places.append(float(np.nanmean(block)))
                scatters.append(_scatter_m(block))
    correlation = max(float(np.median(ratios)), 1.0) if ratios else 1.0
    correlation = correlation if correlation > 1.1 else 1.0  # noqa: PLR2004 - the scatter of the ratio itself
    of_reading, of_span_m = _line(np.abs(np.asarray(places)), np.asarray(scatters))
    samples = len(places) * _BLOCK
    return Noise(of_reading * correlation, of_span_m * correlation, 1.0 / math.sqrt(max(samples, 2)), correlation)


def _scatter_m(readings: NDArray[np.float64]) -> float:
    """Return σ of white noise from the second differences, whose variance is 6 σ²."""
    second = np.diff(readings, 2)
    second = second[~np.isnan(second)]
    if len(second) == 0:
        return 0.0
    # a jump of the stem is no noise
    typical = float(np.median(np.abs(second)))
    kept = second[np.abs(second) <= 6.0 * typical] if typical else second
    return float(np.sqrt(np.mean(kept * kept) / 6.0))


def _line(places_m: NDArray[np.float64], scatters_m: NDArray[np.float64]) -> tuple[float, float]:
    """Return a and b of σ = a·x + b, none of them negative; a part that is not certain is left out."""
    typical = float(np.median(scatters_m))
    if typical == 0.0:
        return 0.0, float(np.mean(scatters_m))
    weight = 1.0 / typical
    columns = np.stack([places_m, np.ones_like(places_m)], axis=1) * weight
    wanted = scatters_m * weight
    both, *_ = np.linalg.lstsq(columns, wanted, rcond=None)
    residual = wanted - columns @ both
    spread = float(residual @ residual) / max(len(wanted) - 2, 1)
    errors = np.sqrt(np.diag(np.linalg.pinv(columns.T @ columns)) * spread)
    if both[0] > _CERTAIN * errors[0] and both[1] > _CERTAIN * errors[1]:
        return float(both[0]), float(both[1])
    slope, level = float(np.mean(scatters_m) / np.mean(places_m)), float(np.mean(scatters_m))
    proportional = float(np.sum(((scatters_m - slope * places_m) * weight) ** 2))
    constant = float(np.sum(((scatters_m - level) * weight) ** 2))
    return (slope, 0.0) if proportional < constant else (0.0, level)
