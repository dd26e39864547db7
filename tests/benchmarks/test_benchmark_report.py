"""Tables, goals and picture of a benchmark whose durations are known."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from benchmarks.cases import LAGGED
from benchmarks.measure import Measured
from benchmarks.picture import draw
from benchmarks.report import report
from benchmarks.summary import summarize

if TYPE_CHECKING:
    from pathlib import Path

    from benchmarks.tables import Entry

MACHINE = {
    "machine": {
        "processor": "2 × test",
        "date": "2026-01-01",
        "commit": "abc",
        "rounds": 2,
        "versions": {"Python": "3.11.7 (x)"},
    }
}
CYCLES = ("cycle, 1 kHz, seed 1", f"cycle, {LAGGED}, seed 1")
LABELS = ("at rest", "in a move", "settling")


def plan(name: str, build: str, ns: int, first_ma: float | None = 10.0) -> Measured:
    return Measured(name, build, ("plan",), [[ns]], [json.dumps([first_ma])])


def measured(first_ma: float = 10.002) -> list[Measured]:
    cycles = [
        Measured(name, build, LABELS, [[40_000, 140_000, 60_000], [99_000, 700_000, 50_000]], ["a", "a"])
        for name in (
            "cycle, 1 kHz, seed 1",
            f"cycle, {LAGGED}, seed 1",
            "bus, embedded, echo",
            "bus, embedded, daemon",
        )
        for build in ("interpreted", "compiled")
    ]
    plans = [
        plan("plan, ours", "interpreted", 300_000),
        plan("plan, ours", "compiled", 100_000),
        plan("plan, qpmpc + daqp", "interpreted", 450_000, first_ma),
        plan("plan, do-mpc", "interpreted", 5_000_000),
    ]
    valves = Measured("valves, 2", "compiled", ("period",) * 2, [[90_000, 150_000], [100_000, 110_000]], ["v", "v"])
    return [
        *cycles,
        *plans,
        valves,
        Measured("simulation, frames", "compiled", ("run",), [[10**9], [8 * 10**8]], ["x", "x"]),
    ]


def document() -> Entry:
    return MACHINE | summarize(measured())


def test_a_cycle_counts_with_its_smallest_duration_and_all_repeats_stand_in_brackets() -> None:
    assert "| in a move, 1 kHz | compiled | 1 | 140 (140) | 140 (700) | 140 (700) | 140 (700) |" in report(document())


def test_the_ratio_of_another_program_is_that_to_the_fastest_build() -> None:
    text = report(document())
    assert "| qpmpc + daqp | 1 | 450 (450) | 450 (450) | 450 (450) | 450 (450) | 4.5 | 2.0 |" in text
    assert "| ours, interpreted | 1 | 300 (300) | 300 (300) | 300 (300) | 300 (300) | 3.0 | 0.0 |" in text


def test_the_valves_of_a_core_follow_from_the_mean_of_the_smallest_periods() -> None:
    assert "| 2 | compiled | 50 | 20 | 90 | 110 | 110 | 110 |" in report(document())


def test_a_goal_says_whether_it_holds() -> None:
    told = {goal["what"]: goal["holds"] for goal in document()["goals"]}
    assert told["cycle in a move, 1 kHz, compiled: p99, µs"]
    lagged = [what for what in told if LAGGED in what]
    assert lagged == [f"cycle {mode}, {LAGGED}, compiled: p99, µs" for mode in LABELS]
    assert told["plan, do-mpc: median, times ours"]
    assert not told["plan, qpmpc + daqp: median, times ours"]
    assert told["simulation, frames, compiled: times real time"]


def test_a_program_that_solves_another_problem_is_refused() -> None:
    with pytest.raises(RuntimeError, match=r"qpmpc \+ daqp plans other inputs than ours, by up to 0.500 mA"):
        summarize(measured(first_ma=10.5))


def test_the_picture_is_drawn(tmp_path: Path) -> None:
    draw(tmp_path / "picture.png", document())
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")
