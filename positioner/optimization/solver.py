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
_SOLVED = int(osqp.SolverStatus.OSQP_SOLVED)


class _Numbers:
    """An array of a fixed size that is filled again and again."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.array = np.zeros(size)
        self._memory, self._pack_into = self.array.data, Struct(f"{size}d").pack_into

    def fill(self, values: Sequence[float]) -> None:
        """Copy `values` into the array."""
        self._pack_into(self._memory, 0, *values)


class QpSolver:
    """Solves programmes with H_u inputs and H_p outputs, warm-started."""

    def __init__(self, inputs: int, steps: int, *, tolerance: float = 1e-5, max_iterations: int = 400) -> None:
        triangle, rows = np.triu(np.ones((inputs, inputs))), np.tril(np.ones((steps, inputs)))
        self._P, self._A = _Numbers(int(triangle.sum())), _Numbers(inputs + int(rows.sum()))
        self._q, self._l, self._u = _Numbers(inputs), _Numbers(inputs + steps), _Numbers(inputs + steps)
        self._z, self._y = _Numbers(inputs), _Numbers(inputs + steps)
        self._sizes = tuple(each.size for each in (self._P, self._q, self._A, self._l, self._u))
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
        # the first solution takes three times as long as the next ones: it shall not be that of a move
        self._solved()
        self._begin((0.0,) * inputs, (0.0,) * (inputs + steps))

    def solve(
        self,
        program: QuadraticProgram,
        inputs: Sequence[float] | None = None,
        multipliers: Sequence[float] | None = None,
    ) -> list[float] | None:
        """Return the minimiser (H_u,), or None where there is none: infeasible, not converged, or a value not finite.

        It is sought from `inputs` (H_u,) and `multipliers` (H_u + H_p,) on, or from the last solution.

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
        new_P, new_A = P is not self._matrices[0], A is not self._matrices[1]
        if (new_P and not math.isfinite(sum(P))) or (new_A and not math.isfinite(sum(A))):
            return None
        self._matrices = (P, A)
        if new_P:
            self._P.fill(P)
        if new_A:
            self._A.fill(A)
        self._q.fill(q)
        self._l.fill(low)
        self._u.fill(high)
        P_x, A_x = self._P.array if new_P else None, self._A.array if new_A else None
        workspace = self._workspace
        if workspace is None:
            self._update_by_class(P_x, A_x)
        else:
            if new_P or new_A:
                workspace.update_data_mat(P_x, None, A_x, None)
            workspace.update_data_vec(self._q.array, self._l.array, self._u.array)
        if inputs is not None and multipliers is not None:
            self._begin(inputs, multipliers)
        solution = self._solved()
        if solution is None:
            self._begin((0.0,) * len(q), (0.0,) * len(low))
        return solution

    def _begin(self, inputs: Sequence[float], multipliers: Sequence[float]) -> None:
        """Begin the next solution with these values."""
        self._z.fill(inputs)
        self._y.fill(multipliers)
        (self._workspace or self._solver).warm_start(self._z.array, self._y.array)

    def _update_by_class(self, P_x: NDArray[np.float64] | None, A_x: NDArray[np.float64] | None) -> None:
        """Update the workspace by OSQP's class, which keeps the arrays; P and A are new unless None."""
        matrices = {name: array.copy() for name, array in (("Px", P_x), ("Ax", A_x)) if array is not None}
        self._solver.update(q=self._q.array.copy(), l=self._l.array.copy(), u=self._u.array.copy(), **matrices)

    def _solved(self) -> list[float] | None:
        """Return the solution, None where there is none."""
        workspace = self._workspace
        if workspace is None:
            result = self._solver.solve(raise_error=False)
            status, values = result.info.status_val, result.x
        else:
            workspace.solve()
            status, values = workspace.info.status_val, workspace.solution.x
        if status != _SOLVED:
            return None
        solution: list[float] = values.tolist()
        return solution


def _are_crossed(low: Sequence[float], high: Sequence[float]) -> bool:
    """Return whether a lower bound is above the upper one."""
    for i in range(len(low)):  # noqa: SIM110 - a generator takes longer
        if low[i] > high[i]:
            return True
    return False
