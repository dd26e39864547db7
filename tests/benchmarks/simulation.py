"""The speed of a simulation: one run of the bench's first scenario, without bus and processes."""

from __future__ import annotations

from time import perf_counter_ns
from typing import TYPE_CHECKING

from benchmarks.case import Play
from positioner.bench.inprocess import run_in_process
from positioner.bench.scenario import load_scenario
from positioner.studies.direct import play_directly

if TYPE_CHECKING:
    from positioner.bench.scenario import Scenario

SCENARIO = "paper-valve"


class SimulationCase:
    """The whole run, with frames or without; the one duration is that of the run."""

    def __init__(self, *, frames: bool) -> None:
        self._scenario, self._frames = load_scenario(SCENARIO), frames
        self.labels = ("run",)

    def play(self) -> Play:
        """Return the duration of the run, and its figures."""
        began = perf_counter_ns()
        result = _play(self._scenario, frames=self._frames)
        return Play([perf_counter_ns() - began], result)


def _play(scenario: Scenario, *, frames: bool) -> str:
    if frames:
        return repr(run_in_process(scenario).recording.trace.position_m.sum())
    return repr([dwell.mean_abs_error_pct for dwell in play_directly(scenario)])
