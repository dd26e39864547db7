"""Condensing a linear time-variant horizon to a quadratic programme in the inputs alone. Pure.

Letters follow the literature: the horizon is x(i+1) = A_i x(i) + B_i u(i) + c_i for i = 0 .. H_p - 1 (paper eqs 19, 20,
with the affine term of D5), the programme is min ½ z'Pz + q'z subject to l ≤ Az ≤ u, with z the H_u inputs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Horizon:
    """The linear model along the horizon: A (H_p, n, n), B (H_p, n), c (H_p, n)."""

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    c: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Prediction:
    """States as an affine function of the inputs: x(i+1) = free[i] + forced[i] @ z.

    free (H_p, n): the response without input; forced (H_p, n, H_u): the response to the inputs.
    """

    free: NDArray[np.float64]
    forced: NDArray[np.float64]

    def states(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the states (H_p, n) under `inputs` (H_u,)."""
        return self.free + self.forced @ inputs


@dataclass(frozen=True, slots=True)
class QuadraticProgram:
    """min ½ z'Pz + q'z subject to l ≤ Az ≤ u; P (n, n) symmetric, q (n,), A (m, n), l and u (m,)."""

    P: NDArray[np.float64]
    q: NDArray[np.float64]
    A: NDArray[np.float64]
    l: NDArray[np.float64]  # noqa: E741 - the literature's letter
    u: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Solution:
    """The minimiser z (n,) and the multipliers y (m,) of a solved programme."""

    z: NDArray[np.float64]
    y: NDArray[np.float64]


class Solver(Protocol):
    """What the planner needs of a solver: see `positioner.optimization.solver.QpSolver`."""

    def solve(self, program: QuadraticProgram) -> Solution | None:
        """Return the solution of `program`, or None where there is none."""


def predict(horizon: Horizon, start: NDArray[np.float64], control_steps: int) -> Prediction:
    """Return the prediction from the state `start` (n,); the last of the `control_steps` inputs is held (eq. 17)."""
    steps, size = horizon.B.shape
    free = np.empty((steps, size))
    forced = np.zeros((steps, size, control_steps))
    state, response = start, np.zeros((size, control_steps))
    for i in range(steps):
        # Loop invariant: x(i) == state + response @ z
        state = horizon.A[i] @ state + horizon.c[i]
        response = horizon.A[i] @ response
        response[:, min(i, control_steps - 1)] += horizon.B[i]
        free[i], forced[i] = state, response
    return Prediction(free, forced)


def tracking_cost(
    position: NDArray[np.float64], error_weight: NDArray[np.float64], input_weight: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return P (H_u, H_u) and G (H_u, H_p) of eq. 17: ½ z'Pz - z'G (r - free) is its cost, but for a constant.

    The cost is Σ error_weight[i] (r - x_1(i+1))² + input_weight Σ z², with the positions x_1 = free + `position` z;
    position (H_p, H_u), error_weight (H_p,). It is divided by 2 `input_weight`: P is then 1 plus something.
    """
    gradient = position.T * (error_weight / input_weight)
    return gradient @ position + np.eye(position.shape[1]), gradient
