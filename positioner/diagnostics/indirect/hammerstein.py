"""A sticking valve before a linear process: does it explain PV better than OP alone, and with which S and J. Pure.

- HAMM: the modelled stem in place of OP, in a process of low order. M. Jelali, Estimation of valve stiction in control
  loops using separable least-squares and global search algorithms, J. Process Control 18 (2008) 632-642; S. Karra and
  M. N. Karim, Comprehensive methodology for detection and diagnosis of oscillatory control loops, Control Engineering
  Practice 17 (2009) 939-956; K. H. Lee, Z. Ren and B. Huang, in Detection and Diagnosis of Stiction in Control Loops,
  Springer 2010.
- ADD: the modelled stem beside OP, in a process of high order: a likelihood ratio, N·ln(e_0/e_1).

Both choose the stem from the same pairs of S and J.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from positioner.diagnostics.indirect.loop import range_of
from positioner.diagnostics.indirect.method import Answer
from positioner.diagnostics.indirect.regression import added_sums, lagged, residual_sum
from positioner.diagnostics.indirect.valve_model import stem_positions
from positioner.diagnostics.verdict import Estimate

Array = NDArray[np.float64]

_PAST, _INPUTS, _LOW_PAST = 10, 6, 2
"""Lags of PV and OP in ARX(10, 6), and of PV in the process of low order."""
_STICK = np.geomspace(0.03, 0.95, 24)
"""S, of the range of OP."""
_JUMP = np.array([0.0, 0.35, 0.7, 1.0])
"""J, of S."""
_CHI_SQUARE_95 = 3.841
_INFLATED = 4.0
"""The modelled stem is not the true one, so the likelihood is flatter than its formula says."""
_MODEL_ERROR = 0.28
"""Of S: what the model leaves open on emulated loops, besides the likelihood (docs/diagnostics.md)."""
LEAST = 80


@dataclass(frozen=True, slots=True)
class Models:
    """The answers of both methods, and the S of the stem that explains PV best beside OP; J is hardly identifiable.

    is_smallest: whether no smaller S was tried. response: a likelihood ratio, N·ln(e_0/e_1), of how much better OP
    explains PV than PV's own past does, whatever the valve.
    """

    hammerstein: Answer
    ratio: Answer
    stick: Estimate
    is_smallest: bool = False
    response: float = math.inf


def models(op: Array, pv: Array, keep: NDArray[np.bool_]) -> Models:
    """Return what the modelled valves explain; samples that `keep` leaves out are no targets."""
    extent = range_of(op)
    target, weight = pv[_PAST:], keep[_PAST:].astype(np.float64)
    count = int(np.sum(weight))
    nothing = Estimate(math.nan, math.nan)
    if count < LEAST or extent <= 0.0 or float(np.ptp(pv)) <= 0.0:
        note = f"{count} samples, {LEAST} needed" if count < LEAST else "OP or PV stands still"
        return Models(_hamm(math.nan, 1, note), _add(math.nan, note), nothing)
    stick, jump = (each.ravel() for each in np.meshgrid(extent * _STICK, _JUMP, indexing="ij"))
    stems = stem_positions(op, stick, stick * jump)
    past, inputs = lagged(pv, range(1, _PAST + 1), _PAST), lagged(op, range(1, _INPUTS + 1), _PAST)
    added = np.stack([lagged(stems[:, each], range(1, _INPUTS + 1), _PAST) for each in range(stick.size)])
    alone = residual_sum(target, np.concatenate([past, inputs], axis=1), weight)
    response = _logarithm(count, residual_sum(target, past, weight), alone)
    beside = added_sums(target, np.concatenate([past, inputs], axis=1), added, weight)
    low = past[:, :_LOW_PAST]
    linear = residual_sum(target, np.concatenate([low, inputs], axis=1), weight)
    instead = added_sums(target, low, added, weight)
    best, best_low = int(np.argmin(beside)), int(np.argmin(instead))
    ratio = _logarithm(count, alone, float(beside[best]))
    gain = 1.0 - float(instead[best_low]) / max(linear, 1e-300)
    likely = _INFLATED * _CHI_SQUARE_95
    profile = np.min(
        count * np.log(np.maximum(beside, 1e-300) / max(float(beside[best]), 1e-300)).reshape(_STICK.size, _JUMP.size),
        axis=1,
    )
    inside = extent * _STICK[profile <= likely]
    step = math.sqrt(float(_STICK[1] / _STICK[0]))
    lowest, highest = float(inside[0]) / step, float(inside[-1]) * step
    middle = 0.5 * (lowest + highest)
    estimate = Estimate(middle, math.hypot(0.5 * (highest - lowest), _MODEL_ERROR * middle))
    note = f"S {stick[best_low]:.3g}"
    beside_note = f"S {stick[best]:.3g}"
    is_smallest = best < _JUMP.size
    return Models(_hamm(gain, count, note), _add(ratio, beside_note), estimate, is_smallest, response)


def _logarithm(count: int, before: float, after: float) -> float:
    return count * math.log(max(before, 1e-300) / max(after, 1e-300))


def _hamm(gain: float, count: int, note: str) -> Answer:
    """Return the answer of HAMM: the part of the linear model's error that the valve removes.

    It says yes where the valve removes 3 % and what 40 units of the likelihood ratio mean, no where half of that.
    """
    limit = max(0.03, 1.0 - math.exp(-40.0 / count))
    return Answer("HAMM", "Jelali 2008, Karra, Karim 2009", gain, limit, 0.5 * limit, note)


def _add(ratio: float, note: str) -> Answer:
    return Answer("ADD", "likelihood ratio", ratio, 40.0, 20.0, note)
