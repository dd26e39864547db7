"""Every case of the benchmark by name; a name says what is measured and under which conditions."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from benchmarks.cycles import CycleCase, scenario
from benchmarks.plans import PERIOD_S, PlanCase, one_pass, recorded_plans
from benchmarks.problem import control_problem

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from benchmarks.case import Case
    from benchmarks.peers import Peer
    from benchmarks.problem import ControlProblem

HORIZONS = (4, 20)
"""H_p = H_u of the plans that are compared with other programs."""
SEEDS = (1, 2)


def cycle_cases() -> Mapping[str, Callable[[], Case]]:
    """Return the cycles at 1 and at 10 kHz, which some hundreds of move cycles each belong to."""
    slow = {f"cycle 1 kHz seed {seed}": partial(_cycles, 1e-3, 40, 0.05, seed) for seed in SEEDS}
    return slow | {"cycle 10 kHz seed 1": partial(_cycles, 1e-4, 10, 0.03, 1)}


def plan_cases() -> Mapping[str, Callable[[], Case]]:
    """Return our own plans, of one programme each."""
    return {f"plan H_p {horizon} ours": partial(PlanCase, horizon) for horizon in HORIZONS}


def peer_cases() -> Mapping[str, Callable[[], Case]]:
    """Return the same problems, given to the other programs."""
    return {
        f"plan H_p {horizon} {name}": partial(_peer, name, horizon)
        for horizon in HORIZONS
        for name in ("qpmpc + daqp", "qpmpc + OSQP")
    }


def _cycles(period_s: float, setpoints: int, dwell_s: float, seed: int) -> Case:
    return CycleCase(scenario(period_s, setpoints, dwell_s, seed))


def _problems(horizon: int) -> list[ControlProblem]:
    law, planned = recorded_plans(horizon)
    settings, model = one_pass(law), law.filter.model
    return [control_problem(settings, model, each, PERIOD_S) for each in planned]


def _peer(name: str, horizon: int) -> Case:
    from benchmarks.peer_qpmpc import with_daqp, with_osqp  # noqa: PLC0415 - only where peers are installed
    from benchmarks.peers import PeerCase  # noqa: PLC0415

    makers: dict[str, Callable[[int], Peer]] = {"qpmpc + daqp": with_daqp, "qpmpc + OSQP": with_osqp}
    return PeerCase(makers[name], _problems(horizon))
