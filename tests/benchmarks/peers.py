"""Other programs on the same control problem, each used as its own documentation advises, and warm-started.

They are given the matrices and bounds of the problem.
"""

from __future__ import annotations

import json
from time import perf_counter_ns
from typing import TYPE_CHECKING, Protocol

from benchmarks.case import Play

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

    from benchmarks.problem import ControlProblem

    Array = NDArray[np.float64]


class Peer(Protocol):
    """A program that keeps what it needs for a warm start."""

    def solve(self, problem: ControlProblem) -> Array:
        """Return the inputs δu (N,) of `problem` in mA."""


class PeerCase:
    """All recorded problems, one after another, by a fresh instance of a peer in every repeat."""

    def __init__(self, make: Callable[[int], Peer], problems: list[ControlProblem]) -> None:
        self._make, self._problems = make, problems
        self.labels = ("plan",) * len(problems)

    def play(self) -> Play:
        """Return the durations, and the first inputs in mA."""
        peer = self._make(self._problems[0].steps)
        peer.solve(self._problems[0])
        durations_ns: list[int] = []
        first_ma: list[float] = []
        for problem in self._problems:
            began = perf_counter_ns()
            found = peer.solve(problem)
            durations_ns.append(perf_counter_ns() - began)
            first_ma.append(float(found[0]))
        return Play(durations_ns, json.dumps(first_ma))
