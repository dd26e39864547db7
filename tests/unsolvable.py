"""A quadratic programme that has no solution."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.optimization.qp import QuadraticProgram


class Unsolvable:
    """A solver that never finds anything."""

    def solve(
        self,
        program: QuadraticProgram,
        inputs: Sequence[float] | None = None,
        multipliers: Sequence[float] | None = None,
    ) -> None:
        del program, inputs, multipliers
