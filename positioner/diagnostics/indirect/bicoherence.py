"""Choudhury (2004): nonlinear by the bicoherence of the error, then an ellipse of OP and PV for S. Pure.

M. A. A. S. Choudhury, S. L. Shah, N. F. Thornhill, Diagnosis of poor control-loop performance using higher-order
statistics, Automatica 40 (2004) 1719-1728; with D. S. Shook, Automatic detection and quantification of stiction in
control valves, Control Engineering Practice 14 (2006) 1395-1412.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from positioner.diagnostics.indirect.loop import robust_sigma
from positioner.diagnostics.indirect.method import Answer

Array = NDArray[np.float64]

NAME, SOURCE = "BIC", "Choudhury et al. 2004"
_SEGMENT = 64
_LEAST = 1000
_NGI, _NLI = 0.001, 0.01
_CHI_SQUARE_95 = 5.991
"""Of two degrees of freedom: twice the number of segments times the squared bicoherence of a Gaussian signal."""


def bicoherence(error: Array) -> Answer:
    """Return NLI where NGI is above its limit; the signal needs about 1000 stationary samples."""
    if error.size < _LEAST:
        return Answer(NAME, SOURCE, math.nan, _NLI, _NLI, f"{error.size} samples, {_LEAST} needed")
    squared, segments = squared_bicoherence(error)
    limit = _CHI_SQUARE_95 / (2.0 * segments)
    significant = squared[squared > limit]
    by_chance = 0.05 + 3.0 * math.sqrt(0.05 * 0.95 / squared.size)
    gaussian = float(np.mean(significant)) - limit if significant.size > by_chance * squared.size else 0.0
    largest, mean, spread = float(np.max(squared)), float(np.mean(squared)), float(np.std(squared))
    linear = abs(largest - (mean + 2.0 * spread))
    if gaussian <= _NGI:
        return Answer(NAME, SOURCE, 0.0, _NLI, _NLI, f"NGI {gaussian:.4f}: Gaussian and linear")
    return Answer(NAME, SOURCE, linear, _NLI, _NLI, f"NGI {gaussian:.4f}")


def squared_bicoherence(signal: Array) -> tuple[Array, int]:
    """Return bic²(f_1, f_2) of the principal domain, 0 < f_2 ≤ f_1 and f_1 + f_2 < 1/2, and the number of segments."""
    values = (signal - float(np.mean(signal))) / max(float(np.std(signal)), 1e-300)
    step = _SEGMENT // 2
    begins = np.arange(0, values.size - _SEGMENT + 1, step)
    window = np.hanning(_SEGMENT)
    pieces = np.stack([values[b : b + _SEGMENT] for b in begins])
    pieces = (pieces - np.mean(pieces, axis=1, keepdims=True)) * window
    spectrum = np.fft.rfft(pieces, axis=1)
    half = _SEGMENT // 2
    found = []
    for first in range(1, half):
        for second in range(1, min(first, half - first - 1) + 1):
            product = spectrum[:, first] * spectrum[:, second]
            third = spectrum[:, first + second]
            triple = np.mean(product * np.conj(third))
            below = float(np.mean(np.abs(product) ** 2) * np.mean(np.abs(third) ** 2))
            found.append(float(np.abs(triple) ** 2) / below if below > 0.0 else 0.0)
    # half of each segment is shared with the next: about two thirds of them count as independent
    return np.array(found), max(round(begins.size * 2 / 3), 1)


def ellipse_width(op: Array, pv: Array) -> float:
    """Return the width in OP, at the level of its centre, of the ellipse that OP and PV describe; an apparent S."""
    first, second = op - float(np.mean(op)), pv - float(np.mean(pv))
    a, b = robust_sigma(first), robust_sigma(second)
    if a <= 0.0 or b <= 0.0:
        return 0.0
    correlation = float(np.clip(np.mean(first * second) / (np.std(first) * np.std(second)), -1.0, 1.0))
    # two sinusoids of the same period with amplitude A and phase φ, cos φ the correlation: the width is 2·A·sin φ
    return 2.0 * float(np.std(first)) * math.sqrt(2.0) * math.sqrt(1.0 - correlation * correlation)
