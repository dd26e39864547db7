"""qpmpc, with daqp and with OSQP: it condenses a linear time-varying problem, and a solver of qpsolvers solves it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from qpmpc import MPCProblem, solve_mpc

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.problem import ControlProblem

    Array = NDArray[np.float64]

_SMALL = 1e-6
"""The unit of the last change: qpmpc weights all states alike, and this one must not cost anything."""


class Qpmpc:
    """One solver of qpmpc, which starts from its last solution if it can."""

    def __init__(self, solver: str, steps: int, **options: Any) -> None:
        self._solver, self._options = solver, options
        self._last = np.zeros(steps)

    def solve(self, problem: ControlProblem) -> Array:
        """Return the inputs (N,) in mA."""
        limits = np.column_stack((problem.high, -problem.low, problem.up, -problem.down))
        ours = MPCProblem(
            transition_state_matrix=np.diag([1.0, 0.0]),
            transition_input_matrix=[np.array([[g], [_SMALL]]) for g in problem.g],
            ineq_state_matrix=np.array([[0.0, 0.0], [0.0, 0.0], [0.0, -1.0 / _SMALL], [0.0, 1.0 / _SMALL]]),
            ineq_input_matrix=np.array([[1.0], [-1.0], [1.0], [-1.0]]),
            ineq_vector=list(limits),
            nb_timesteps=problem.steps,
            terminal_cost_weight=problem.weight,
            stage_state_cost_weight=None,
            stage_input_cost_weight=1.0,
            initial_state=np.array([problem.error, 0.0]),
            goal_state=np.zeros(2),
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
