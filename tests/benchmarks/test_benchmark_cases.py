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
from benchmarks.plans import PlanCase, recorded_programs
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
        labels = worker.ask("cycle, 1 kHz, seed 1")["labels"]
        played = worker.ask("cycle, 1 kHz, seed 1")
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
    """Return δ: the programme as one of least distance, solved exactly (Lawson and Hanson 1974, chapter 23)."""
    count = problem.steps
    hessian = np.eye(count) + problem.weight * np.outer(problem.g, problem.g)
    free = np.linalg.solve(hessian, -problem.weight * problem.error * problem.g)
    whitening = np.linalg.inv(np.linalg.cholesky(hessian)).T  # δ = free + whitening @ y, with the least |y|
    changes = np.eye(count) - np.eye(count, k=-1)
    bounded = np.vstack([np.eye(count), -np.eye(count), changes, -changes])
    least = np.concatenate([problem.low, -problem.high, problem.down, -problem.up]) - bounded @ free
    system = np.vstack([(bounded @ whitening).T, least])
    target = np.eye(count + 1)[-1]
    residual = system @ nnls(system, target)[0] - target
    found: NDArray[np.float64] = free - whitening @ (residual[:-1] / residual[-1])
    return found


def test_the_problem_of_the_other_programs_has_the_solution_of_our_programme() -> None:
    programs = recorded_programs()
    first_ma = json.loads(PlanCase().play().result)
    assert len(programs) > 100
    assert None not in first_ma
    exact_ma = [minimiser(control_problem(program))[0] for program in programs]
    assert max(map(abs, exact_ma)) > 0.1
    assert first_ma == pytest.approx(exact_ma, abs=MOST_APART_MA)
