"""The persistent OSQP workspace: one per law, set up once, updated every cycle. Stateful; no I/O, no clock.

OSQP accepts arrays of a wrong length in silence, so every size is checked here. The numbers are packed into arrays that
are made once. The workspace is called directly: OSQP's Python class would add a quarter to half of the time
of a small programme. A version of OSQP without these calls is used through its class, with the same results.

Results are bit-identical for the same sequence of problems: no time limit is ever set, and the default adaptive rho
counts iterations.
"""

from __future__ import annotations

import math
from struct import Struct
from typing import TYPE_CHECKING, Any

import numpy as np
import osqp
from scipy import sparse

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.optimization.qp import QuadraticProgram

_DIRECT_CALLS = ("update_data_vec", "update_data_mat", "warm_start", "solve", "info", "solution")


class QpSolver:
    """Solves programmes with H_u inputs and H_p outputs, warm-started from the last one."""

    def __init__(self, inputs: int, steps: int, *, tolerance: float = 1e-5, max_iterations: int = 400) -> None:
        triangle, rows = np.triu(np.ones((inputs, inputs))), np.tril(np.ones((steps, inputs)))
        self._P, self._A = np.zeros(int(triangle.sum())), np.zeros(inputs + int(rows.sum()))
        self._q, self._l, self._u = np.zeros(inputs), np.zeros(inputs + steps), np.zeros(inputs + steps)
        self._packs = tuple(Struct(f"{len(each)}d").pack_into for each in (self._P, self._q, self._A, self._l, self._u))
        self._sizes = tuple(len(each) for each in (self._P, self._q, self._A, self._l, self._u))
        self._matrices: tuple[Sequence[float] | None, Sequence[float] | None] = (None, None)
        self._solver: Any = osqp.OSQP()
        # set up with every entry of the pattern present, so that any later matrix fits it
        self._solver.setup(
            P=sparse.csc_matrix(0.1 * triangle + inputs * np.eye(inputs)),
            q=np.zeros(inputs),
            A=sparse.csc_matrix(np.vstack([np.eye(inputs), rows])),
            l=np.full(inputs + steps, -1.0),
            u=np.full(inputs + steps, 1.0),
            verbose=False,
            scaling=0,
            eps_abs=tolerance,
            eps_rel=tolerance,
            max_iter=max_iterations,
            check_termination=5,
        )
        workspace = getattr(self._solver, "_solver", None)
        self._workspace: Any = workspace if all(hasattr(workspace, name) for name in _DIRECT_CALLS) else None

    def solve(self, program: QuadraticProgram) -> list[float] | None:
        """Return the minimiser (H_u,), or None where there is none: infeasible, not converged, or a value not finite.

        Raises:
            ValueError: an array of the programme does not have the size of the workspace.
        """
        P, q, A, low, high = program.P, program.q, program.A, program.l, program.u
        sizes = (len(P), len(q), len(A), len(low), len(high))
        if sizes != self._sizes:
            raise ValueError(f"programme of sizes {sizes} in a workspace of {self._sizes}")
        # opposite infinities do not cancel: their sum is not a number
        if not math.isfinite(sum(q) + sum(low) + sum(high)) or _are_crossed(low, high):
            return None
        P_x = A_x = None
        if P is not self._matrices[0]:
            if not math.isfinite(sum(P)):
                return None
            self._packs[0](self._P.data, 0, *P)
            P_x = self._P
        if A is not self._matrices[1]:
            if not math.isfinite(sum(A)):
                return None
            self._packs[2](self._A.data, 0, *A)
            A_x = self._A
        self._matrices = (P, A)
        self._packs[1](self._q.data, 0, *q)
        self._packs[3](self._l.data, 0, *low)
        self._packs[4](self._u.data, 0, *high)
        solution = self._solved(P_x, A_x)
        if solution is None:
            (self._workspace or self._solver).warm_start(np.zeros_like(self._q), np.zeros_like(self._l))
        return solution

    def _solved(self, P_x: NDArray[np.float64] | None, A_x: NDArray[np.float64] | None) -> list[float] | None:
        """Return the solution of the packed programme; P and A are new unless None."""
        workspace = self._workspace
        if workspace is None:
            return self._solved_by_class(P_x, A_x)
        if P_x is not None or A_x is not None:
            workspace.update_data_mat(P_x, None, A_x, None)
        workspace.update_data_vec(self._q, self._l, self._u)
        workspace.solve()
        if workspace.info.status_val != osqp.SolverStatus.OSQP_SOLVED:
            return None
        solution: list[float] = workspace.solution.x.tolist()
        return solution

    def _solved_by_class(self, P_x: NDArray[np.float64] | None, A_x: NDArray[np.float64] | None) -> list[float] | None:
        """Return the solution of the packed programme, by OSQP's class, which may keep the arrays."""
        matrices = {name: array.copy() for name, array in (("Px", P_x), ("Ax", A_x)) if array is not None}
        self._solver.update(q=self._q.copy(), l=self._l.copy(), u=self._u.copy(), **matrices)
        result = self._solver.solve(raise_error=False)
        if result.info.status_val != osqp.SolverStatus.OSQP_SOLVED:
            return None
        solution: list[float] = result.x.tolist()
        return solution


def _are_crossed(low: Sequence[float], high: Sequence[float]) -> bool:
    """Return whether a lower bound is above the upper one."""
    for i in range(len(low)):  # noqa: SIM110 - a generator takes longer
        if low[i] > high[i]:
            return True
    return False
