"""The shape of half cycles: He's curve fit, Rossi and Scali's relay fit, Singhal and Salsbury's areas. Pure.

Each half cycle is positive, from one zero crossing to the next; its time is scaled to 0 ... 1.

- Q. P. He, J. Wang, M. Pottmann, S. J. Qin, A curve fitting method for detecting valve stiction in oscillating control
  loops, Ind. Eng. Chem. Res. 46 (2007) 4549-4560.
- M. Rossi, C. Scali, A comparison of techniques for automatic detection of stiction, J. Process Control 15 (2005)
  505-514.
- A. Singhal, T. I. Salsbury, A simple method for detecting valve stiction in oscillating control loops, J. Process
  Control 15 (2005) 371-382.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from positioner.diagnostics.indirect.method import Answer

if TYPE_CHECKING:
    from collections.abc import Sequence

Array = NDArray[np.float64]

LEAST_HALVES = 6
_RELAY_LAGS = (0.1, 0.2, 0.35, 0.6, 1.0, 2.0, 5.0)
"""Time constants of the response to a relay, of the half period."""
_PEAKS = np.linspace(0.1, 0.9, 33)
"""Where the peak of a triangle may be, of the half period."""


def curve(halves: Sequence[Array], signal: str) -> Answer:
    """Return He's stiction index, the share of the sine's error in those of sine and triangle; 0.5 is no difference.

    `signal` is the name of what the half cycles are of: OP of a self-regulating process, PV of one that integrates.
    """
    name, source, limits = "CURVE", "He et al. 2007", (0.6, 0.4)
    if len(halves) < LEAST_HALVES:
        return Answer(name, source, math.nan, *limits, f"{len(halves)} half cycles of {signal}")
    sine = math.fsum(_sine_error(half) for half in halves)
    triangle = math.fsum(_triangle_error(half) for half in halves)
    total = sine + triangle
    return Answer(name, source, sine / total if total > 0.0 else math.nan, *limits, f"half cycles of {signal}")


def relay(halves: Sequence[Array]) -> Answer:
    """Return Rossi and Scali's index of PV: (E_sine - E_relay)/(E_sine + E_relay), E_relay of relay or triangle."""
    name, source, limits = "RELAY", "Rossi, Scali 2005", (0.21, -0.21)
    if len(halves) < LEAST_HALVES:
        return Answer(name, source, math.nan, *limits, f"{len(halves)} half cycles of PV")
    found = []
    for half in halves:
        sine = _sine_error(half)
        other = min(_triangle_error(half), _relay_error(half))
        found.append((sine - other) / (sine + other) if sine + other > 0.0 else 0.0)
    return Answer(name, source, float(np.mean(found)), *limits)


def area(halves: Sequence[Array]) -> Answer:
    """Return the median of the area before the peak over the area after it."""
    name, source, limits = "AREA", "Singhal, Salsbury 2005", (1.0, 1.0)
    if len(halves) < LEAST_HALVES:
        return Answer(name, source, math.nan, *limits, f"{len(halves)} half cycles of PV")
    found = []
    for half in halves:
        peak = int(np.argmax(half))
        after = float(np.sum(half[peak:])) - 0.5 * float(half[peak])
        before = float(np.sum(half[:peak])) + 0.5 * float(half[peak])
        found.append(before / after if after > 0.0 else math.inf)
    index = float(np.median(found))
    error = 1.25 * float(np.std(np.minimum(found, 10.0))) / math.sqrt(len(found))
    # the published limit is 1; within two standard errors of it the index says nothing
    return Answer(name, source, index, limits[0] + 2.0 * error, limits[1] - 2.0 * error)


def _times(half: Array) -> Array:
    return (np.arange(half.size) + 0.5) / half.size


def _error(half: Array, shape: Array) -> float:
    """Return the mean square of what the best multiple of a shape leaves."""
    square = float(shape @ shape)
    size = float(shape @ half) / square if square > 0.0 else 0.0
    off = half - size * shape
    return float(off @ off) / half.size


def _sine_error(half: Array) -> float:
    return _error(half, np.asarray(np.sin(math.pi * _times(half))))


def _triangle_error(half: Array) -> float:
    """Return the error of two straight lines from the ends to a peak, wherever it fits best."""
    time = _times(half)[None, :]
    shapes = np.minimum(time / _PEAKS[:, None], (1.0 - time) / (1.0 - _PEAKS[:, None]))
    return min(_error(half, shape) for shape in shapes)


def _relay_error(half: Array) -> float:
    """Return the error of the response of a first-order lag to a relay that switches at the peak."""
    time = _times(half)
    found = []
    for lag in _RELAY_LAGS:
        # from 0 towards 1 until p, then towards -1, and at time 1 back at 0: e^((1-p)/lag) = 2 - e^(-p/lag)
        peak = _relay_peak(lag)
        top = 1.0 - math.exp(-peak / lag)
        rise = 1.0 - np.exp(-time / lag)
        fall = (top + 1.0) * np.exp(-(time - peak) / lag) - 1.0
        found.append(_error(half, np.where(time < peak, rise, fall)))
    return min(found)


def _relay_peak(lag: float) -> float:
    """Return where the response that is 0 at both ends has its peak."""
    # (2 - e^(-p/L))·e^(-(1-p)/L) = 1  ->  2·e^(p/L) = e^(1/L) + 1
    return lag * math.log(0.5 * (math.exp(1.0 / lag) + 1.0))
