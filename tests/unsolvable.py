"""A quadratic programme that has no solution."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from positioner.optimization.qp import QuadraticProgram


class Unsolvable:
    """A solver that never finds anything."""

    def solve(self, program: QuadraticProgram) -> None:
        del program
