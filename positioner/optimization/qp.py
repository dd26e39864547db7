"""The quadratic programme of a predictive controller, with the inputs as its only variables. Pure.

Letters follow the literature: the model is x(i+1) = A x(i) + B u(i) along a horizon of H_p steps (paper eqs 19, 20),
the programme is min ½ z'Pz + q'z subject to l ≤ Az ≤ u, where z are the H_u inputs. The first H_u rows are the inputs,
the other H_p rows the bounded outputs, step by step. An input moves no output before its own step, so A is

    [ identity (H_u, H_u)                ]
    [ zero above its diagonal (H_p, H_u) ]
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from positioner.values import dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class QuadraticProgram:
    """min ½ z'Pz + q'z subject to l ≤ Az ≤ u, in numbers as OSQP keeps them.

    P: the upper triangle of P (H_u, H_u), column by column. A: its columns, each without the zeros of its pattern: the
    1 of its input, then its outputs from its own step on. q (H_u,), l and u (H_u + H_p,).
    """

    P: Sequence[float]
    q: Sequence[float]
    A: Sequence[float]
    l: Sequence[float]  # noqa: E741 - the literature's letter
    u: Sequence[float]


class Solver(Protocol):
    """What a planner needs of a solver: see `positioner.optimization.solver.QpSolver`."""

    def solve(
        self,
        program: QuadraticProgram,
        inputs: Sequence[float] | None = None,
        multipliers: Sequence[float] | None = None,
    ) -> list[float] | None:
        """Return the minimiser z (H_u,) of `program`, or None where there is none.

        It is sought from `inputs` (H_u,) and `multipliers` (H_u + H_p,) on, or from the last solution.
        """


def packed(P: NDArray[np.float64], outputs: NDArray[np.float64]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return P (H_u, H_u) and the rows of the outputs (H_p, H_u) as a `QuadraticProgram` has them."""
    count = len(P)
    triangle = [P[j, k] for k in range(count) for j in range(k + 1)]
    columns = [each for j in range(count) for each in (1.0, *outputs[j:, j])]
    return tuple(float(each) for each in triangle), tuple(float(each) for each in columns)


def forced_response(
    A: NDArray[np.float64], B: NDArray[np.float64], prediction_steps: int, control_steps: int
) -> NDArray[np.float64]:
    """Return the response of the states to the inputs, (H_p, n, H_u), for A (n, n) and B (n,).

    The states without inputs plus this response, times the inputs, are the states. The last of the `control_steps`
    inputs is held to the end (eq. 17).
    """
    forced = np.zeros((prediction_steps, len(B), control_steps))
    response = np.zeros((len(B), control_steps))
    for i in range(prediction_steps):
        # Loop invariant: response @ z is what the inputs have added to x(i)
        response = A @ response
        response[:, min(i, control_steps - 1)] += B
        forced[i] = response
    return forced


def tracking_cost(
    position: NDArray[np.float64], error_weight: NDArray[np.float64], input_weight: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return P (H_u, H_u) and G (H_u, H_p) of eq. 17: ½ z'Pz - z'G (r - free) is its cost, but for a constant.

    The cost is Σ error_weight[i] (r - x_1(i+1))² + input_weight Σ z², with the positions x_1 = free + `position` z;
    position (H_p, H_u), error_weight (H_p,). It is divided by 2 `input_weight`: P is then 1 plus something.
    """
    gradient = position.T * (error_weight / input_weight)
    return gradient @ position + np.eye(position.shape[1]), gradient
