"""Plans of recorded moves: the states at which `nmpc-predictive` planned, and its plan of one pass from each."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from time import perf_counter_ns
from typing import TYPE_CHECKING

from benchmarks.case import Play
from benchmarks.cycles import record, scenario
from positioner.bench.inprocess import configure
from positioner.laws.nmpc.filter import Sliding
from positioner.laws.nmpc.law import NmpcLaw
from positioner.laws.nmpc.plan import plan_move
from positioner.laws.nmpc.start import fastest

if TYPE_CHECKING:
    from positioner.config.schema import Configuration
    from positioner.laws.nmpc.move import Move
    from positioner.laws.nmpc.settings import ApproachSettings

PERIOD_S = 1e-3
_SEED, _SETPOINTS, _DWELL_S = 7, 30, 0.05


@dataclass(frozen=True, slots=True)
class Planned:
    """A move at the instant of a plan, and the inputs (H_u) in mA from which the plan starts."""

    move: Move
    guess_ma: tuple[float, ...]


def one_pass(law: NmpcLaw) -> ApproachSettings:
    """Return the settings of the law's plans, with a single programme for each."""
    return replace(law.settings.approach, max_passes=1)


def immediate(configuration: Configuration) -> NmpcLaw:
    """Return the law that plans by quadratic programmes."""
    law = configuration.make_law()
    assert isinstance(law, NmpcLaw)
    return law


def recorded_plans(horizon: int) -> tuple[NmpcLaw, list[Planned]]:
    """Return a fresh law with H_p = H_u = `horizon`, and every plan of a run for which a programme was solved.

    The first plan of a move is left out: its first input has other limits.
    """
    wanted = replace(scenario(PERIOD_S, _SETPOINTS, _DWELL_S, _SEED, horizon), law="nmpc-predictive")
    configuration = configure(wanted)
    law = immediate(configuration)
    planned: list[Planned] = []
    moving = False
    for cycle in record(wanted, configuration):
        memory = cycle.after.control.memory
        if memory is None or not isinstance(memory.stem, Sliding):
            moving = False
            continue
        if moving and cycle.passes:
            planned.append(_planned(law, law._move(memory, memory.stem, memory.aim_m), horizon))
        moving = True
    return law, planned


def _planned(law: NmpcLaw, move: Move, horizon: int) -> Planned:
    slide, limits = move.slide(law.filter.model, PERIOD_S), move.limits(horizon)
    return Planned(move, tuple(fastest(slide, limits, move.x, move.v, move.target_m)))


class PlanCase:
    """Our own plan of every recorded move: start, prediction, programme and solution."""

    def __init__(self, horizon: int) -> None:
        self._law, self._planned = recorded_plans(horizon)
        self._settings, self._model = one_pass(self._law), self._law.filter.model
        self._configuration = configure(replace(scenario(PERIOD_S, 1, _DWELL_S, _SEED, horizon), law="nmpc-predictive"))
        self.labels = ("plan",) * len(self._planned)

    def play(self) -> Play:
        """Return the durations of all plans, and their first inputs in mA; None for a programme that was not solved."""
        law = immediate(self._configuration)
        durations_ns: list[int] = []
        first_ma: list[float | None] = []
        for planned in self._planned:
            began = perf_counter_ns()
            plan = plan_move(self._settings, self._model, law.solver, planned.move, PERIOD_S)
            durations_ns.append(perf_counter_ns() - began)
            first_ma.append(plan.inputs_ma[0] if plan.is_solved else None)
        return Play(durations_ns, json.dumps(first_ma))
