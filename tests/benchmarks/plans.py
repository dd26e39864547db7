"""The quadratic programmes of recorded moves: all that `nmpc` asks OSQP while it stops stems behind a lag."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from time import perf_counter_ns
from typing import TYPE_CHECKING

from benchmarks.case import Play
from benchmarks.cycles import record, scenario
from positioner.bench.inprocess import configure
from positioner.laws.nmpc.programme import KNOTS
from positioner.laws.registry import make_law
from positioner.optimization.solver import QpSolver

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.optimization.qp import QuadraticProgram, Solver

_SEED, _SETPOINTS, _DWELL_S, _LAG_S, _RATE_MA_PER_S = 7, 60, 0.5, 0.05, 1000.0


class _Recorder:
    """A solver that notes the programmes that it is given."""

    def __init__(self, solver: Solver) -> None:
        self.programs: list[QuadraticProgram] = []
        self._solver = solver

    def solve(
        self,
        program: QuadraticProgram,
        inputs: Sequence[float] | None = None,
        multipliers: Sequence[float] | None = None,
    ) -> list[float] | None:
        """Return what the solver finds."""
        self.programs.append(program)
        return self._solver.solve(program, inputs, multipliers)


@cache
def recorded_programs() -> tuple[QuadraticProgram, ...]:
    """Return every programme of a run: the lag is configured, and the guard limits the rate of the current.

    The run is played once, for all programs that a process measures.
    """
    wanted = scenario(1e-3, _SETPOINTS, _DWELL_S, _SEED, _LAG_S)
    configuration = configure(replace(wanted, guard={"max_rate_ma_per_s": _RATE_MA_PER_S}))
    recorder = _Recorder(QpSolver(KNOTS, KNOTS))
    ingredients = replace(configuration.ingredients, make_solver=lambda _inputs, _steps: recorder)
    for _ in record(wanted, configuration, make_law("nmpc", ingredients)):
        pass
    return tuple(recorder.programs)


class PlanCase:
    """Our own solution of every recorded programme."""

    def __init__(self) -> None:
        self._programs = recorded_programs()
        self.labels = ("plan",) * len(self._programs)

    def play(self) -> Play:
        """Return the durations of all solutions, and their first inputs in mA; None for what was not solved."""
        solver = QpSolver(KNOTS, KNOTS)
        durations_ns: list[int] = []
        first_ma: list[float | None] = []
        for program in self._programs:
            began = perf_counter_ns()
            found = solver.solve(program, (0.0,) * KNOTS, (0.0,) * (2 * KNOTS))  # as the law asks for it
            durations_ns.append(perf_counter_ns() - began)
            first_ma.append(found[0] if found else None)
        return Play(durations_ns, json.dumps(first_ma))
