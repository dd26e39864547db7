"""The programme that places a stop as a linear time-varying control problem, which every other program is given.

Its state is how far the stop is from the target, and the last change: e(i+1) = e(i) + g(i) δ(i) and d(i+1) = δ(i). It
minimises ½ w e(N)² + ½ Σ δ(i)² with δ between `low` and `high`, and δ(i) - d(i) between `down` and `up`. The stop is in
the unit that makes the largest g 1, so in mA.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from dense import dense

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from positioner.optimization.qp import QuadraticProgram

    Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ControlProblem:
    """One problem: e(0) and w, derivatives g (N,) of the stop, and limits low, high, down, up (N,) in mA."""

    error: float
    weight: float
    g: Array
    low: Array
    high: Array
    down: Array
    up: Array

    @property
    def steps(self) -> int:
        """The horizon N."""
        return len(self.g)


def control_problem(program: QuadraticProgram) -> ControlProblem:
    """Return the problem whose programme is `program`: P = 1 + w g g' and q = w e g, with the largest |g| 1."""
    full = dense(program)
    count = len(full.q)
    weight = float(np.diag(full.P).max()) - 1.0
    error = float(np.abs(full.q).max()) / weight
    g = full.q / (weight * error)
    low, down = np.split(full.l, [count])
    high, up = np.split(full.u, [count])
    return ControlProblem(error, weight, g, low, high, down, up)
