"""The persistent OSQP workspace: one per law, set up once, updated every cycle. Stateful; no I/O, no clock.

OSQP accepts arrays of a wrong length in silence and aliases the caller's matrices, so every shape is checked here and
every array is copied in the order of its own sparsity pattern. Results are bit-identical for the same sequence of
problems: no time limit is ever set, and the default adaptive rho counts iterations.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import osqp
from scipy import sparse

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from positioner.optimization.qp import QuadraticProgram


class QpSolver:
    """Solves programmes of one size, warm-started from the last one."""

    def __init__(self, variables: int, constraints: int, *, tolerance: float = 1e-5, max_iterations: int = 400) -> None:
        self._shapes = ((variables, variables), (variables,), (constraints, variables), (constraints,), (constraints,))
        self._matrices: tuple[NDArray[np.float64] | None, NDArray[np.float64] | None] = (None, None)
        self._upper = np.triu_indices(variables)
        order = np.lexsort(self._upper)  # column by column, as OSQP's compressed columns want it
        self._upper = (self._upper[0][order], self._upper[1][order])
        self._solver: Any = osqp.OSQP()
        # set up with every entry present, so that any later matrix fits the sparsity pattern
        self._solver.setup(
            P=sparse.csc_matrix(np.triu(np.full((variables, variables), 0.1) + np.eye(variables) * variables)),
            q=np.zeros(variables),
            A=sparse.csc_matrix(np.ones((constraints, variables))),
            l=np.full(constraints, -1.0),
            u=np.full(constraints, 1.0),
            verbose=False,
            scaling=0,
            eps_abs=tolerance,
            eps_rel=tolerance,
            max_iter=max_iterations,
            check_termination=5,
        )

    def solve(self, program: QuadraticProgram) -> NDArray[np.float64] | None:
        """Return the minimiser (n,), or None where there is none: infeasible, not converged, or a value not finite.

        Raises:
            ValueError: an array of the programme does not have the size of the workspace.
        """
        arrays = (program.P, program.q, program.A, program.l, program.u)
        if tuple(array.shape for array in arrays) != self._shapes:
            raise ValueError(f"programme of shapes {[a.shape for a in arrays]} in a workspace of {self._shapes}")
        finite = _are_finite(program.q, program.l, program.u)
        if not finite or bool((program.l > program.u).any()) or not self._take_matrices(program):
            return None
        self._solver.update(q=program.q.copy(), l=program.l.copy(), u=program.u.copy())
        result = self._solver.solve(raise_error=False)
        if result.info.status_val != osqp.SolverStatus.OSQP_SOLVED:
            self._solver.warm_start(x=np.zeros_like(program.q), y=np.zeros_like(program.l))
            return None
        return np.array(result.x)

    def _take_matrices(self, program: QuadraticProgram) -> bool:
        """Give P and A to the workspace unless it has these very objects already; False where they are not finite."""
        if program.P is self._matrices[0] and program.A is self._matrices[1]:
            return True
        if not _are_finite(program.P, program.A):
            return False
        self._solver.update(Px=program.P[self._upper], Ax=np.ravel(program.A, order="F").copy())
        self._matrices = (program.P, program.A)
        return True


def _are_finite(*arrays: NDArray[np.float64]) -> bool:
    """Return whether every value is finite; by sums of squares, in which opposite infinities cannot cancel."""
    return math.isfinite(sum(float(np.vdot(array, array)) for array in arrays))
