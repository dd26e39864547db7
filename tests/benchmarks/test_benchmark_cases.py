"""What the benchmark measures is what it says: repeats of the recorded cycles, and the very programme of the plan."""

from __future__ import annotations

import ast
import json
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.optimize import nnls

from benchmarks import machine, valves
from benchmarks.builds import ROOT, builds
from benchmarks.bus_latency import BusCase
from benchmarks.cycles import CycleCase, scenario
from benchmarks.measure import start
from benchmarks.plans import PERIOD_S, PlanCase, one_pass, recorded_plans
from benchmarks.problem import control_problem
from benchmarks.summary import MOST_APART_MA

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.problem import ControlProblem


def test_a_run_of_short_dwells_has_cycles_of_every_mode_and_repeats_to_the_bit() -> None:
    case = CycleCase(scenario(1e-3, 2, 0.6, 1))
    assert case.play().result == case.play().result
    counts = Counter(case.labels)
    assert counts["at rest"] > 100
    assert counts["in a move"] > 100


def test_a_repeat_that_sends_other_frames_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    case = CycleCase(scenario(1e-3, 1, 0.05, 1))
    monkeypatch.setattr(case, "_inputs", case._inputs[:-1])
    with pytest.raises(RuntimeError, match="other frames"):
        case.play()


@pytest.mark.bus
@pytest.mark.parametrize("paired", [True, False])
def test_the_daemon_sends_the_recorded_commands_over_a_bus(paired: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "tests"))
    case = BusCase(scenario(1e-3, 1, 0.6, 1), "daemon", paired=paired)
    played = case.play()  # it refuses other commands
    assert len(played.durations_ns) == len(case.labels)
    assert {"at rest", "in a move"} <= set(case.labels)


def test_a_worker_plays_the_cases_that_it_is_asked_for() -> None:
    worker = start(machine.last_core(), builds()["interpreted"])
    try:
        labels = worker.ask("horizon, 4")["labels"]
        played = worker.ask("horizon, 4")
    finally:
        worker.end()
    assert worker.build == "interpreted"
    assert len(played["durations_ns"]) == len(labels) > 400
    assert min(played["durations_ns"]) > 0


def test_a_daemon_of_several_valves_commands_each_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(valves, "_PERIODS", 30)
    monkeypatch.setattr(valves, "_WARM_UP", 10)
    played = valves.ValvesCase(2).play()
    assert len(played.durations_ns) == 30
    frames = ast.literal_eval(played.result)
    assert len(frames) == 2 * 40
    assert all(frames[-20:])


def minimiser(problem: ControlProblem) -> NDArray[np.float64]:
    """Return δu: the programme as one of least distance, solved exactly (Lawson and Hanson 1974, chapter 23)."""
    forced, response = [], np.zeros((2, problem.steps))
    for i, (A, b) in enumerate(zip(problem.A, problem.b, strict=True)):
        response = A @ response
        response[:, i] += b
        forced.append(response.copy())
    positions = np.array(forced)[:, 0]
    hessian = positions.T * problem.weights @ positions + problem.input_weight * np.eye(problem.steps)
    gradient = positions.T @ (problem.weights * problem.errors) + problem.input_weight * problem.targets
    free = np.linalg.solve(hessian, gradient)
    whitening = np.linalg.inv(np.linalg.cholesky(hessian)).T  # δu = free + whitening @ y, with the least |y|
    bounded = np.vstack([-np.einsum("ij,ijk->ik", problem.g, np.array(forced)), np.eye(problem.steps)])
    bounded = np.vstack([bounded, -np.eye(problem.steps)])
    least = np.concatenate([-problem.room, problem.low, -problem.high]) - bounded @ free
    system = np.vstack([(bounded @ whitening).T, least])
    target = np.eye(problem.steps + 1)[-1]
    residual = system @ nnls(system, target)[0] - target
    found: NDArray[np.float64] = free - whitening @ (residual[:-1] / residual[-1])
    return found


@pytest.mark.parametrize("horizon", [4, 20])
def test_the_problem_of_the_other_programs_has_the_solution_of_our_plan(horizon: int) -> None:
    law, planned = recorded_plans(horizon)
    first_ma = json.loads(PlanCase(horizon).play().result)
    assert len(planned) > 100
    apart_ma = []
    for each, ours_ma in zip(planned, first_ma, strict=True):
        problem = control_problem(one_pass(law), law.filter.model, each, PERIOD_S)
        if ours_ma is not None:
            apart_ma.append(abs(problem.guess_ma[0] + minimiser(problem)[0] - ours_ma))
    assert max(apart_ma) < MOST_APART_MA
    assert len(apart_ma) > 100
