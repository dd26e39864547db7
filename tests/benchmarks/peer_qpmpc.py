"""qpmpc, with daqp and with OSQP: it condenses a linear time-varying problem, and a solver of qpsolvers solves it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from qpmpc import MPCProblem, solve_mpc

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.problem import ControlProblem

    Array = NDArray[np.float64]


class Qpmpc:
    """One solver of qpmpc, which starts from its last solution if it can."""

    def __init__(self, solver: str, steps: int, **options: Any) -> None:
        self._solver, self._options = solver, options
        self._last = np.zeros(steps)

    def solve(self, problem: ControlProblem) -> Array:
        """Return the inputs (N,) in mA."""
        steps, A, b, g = problem.steps, problem.A, problem.b, problem.g
        zero = np.zeros(2)
        ours = MPCProblem(
            transition_state_matrix=list(A),
            transition_input_matrix=[column.reshape(2, 1) for column in b],
            # a bound on x(i+1) as one on x(i) and u(i): qpmpc bounds no state after the last input
            ineq_state_matrix=[np.vstack([g[i] @ A[i], zero, zero]) for i in range(steps)],
            ineq_input_matrix=[np.array([[g[i] @ b[i]], [1.0], [-1.0]]) for i in range(steps)],
            ineq_vector=[np.array([problem.room[i], problem.high[i], -problem.low[i]]) for i in range(steps)],
            nb_timesteps=steps,
            terminal_cost_weight=float(problem.weights[-1]),
            stage_state_cost_weight=1.0,
            stage_input_cost_weight=problem.input_weight,
            initial_state=zero,
            goal_state=np.array([problem.errors[-1], 0.0]),
            target_states=np.column_stack([[0.0, *problem.errors[:-1]], np.zeros(steps)]).ravel(),
            target_inputs=problem.targets,
        )
        plan = solve_mpc(ours, self._solver, initvals=self._last, **self._options)
        self._last = plan.qpsol.x
        found: Array = plan.qpsol.x
        return found


def with_daqp(steps: int) -> Qpmpc:
    """Return qpmpc with daqp, an exact active-set method."""
    return Qpmpc("daqp", steps)


def with_osqp(steps: int) -> Qpmpc:
    """Return qpmpc with OSQP, as sparse matrices and to our tolerance."""
    return Qpmpc("osqp", steps, sparse=True, eps_abs=1e-5, eps_rel=1e-5)
