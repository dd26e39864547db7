"""What was measured, as one document: cycles by mode, programmes beside those of others, bus, simulation."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from statistics import fmean
from typing import TYPE_CHECKING, Any

from benchmarks.distribution import Distribution
from benchmarks.goals import goals
from benchmarks.simulation import SCENARIO
from benchmarks.valves import PERIOD_NS
from positioner.bench.scenario import load_scenario

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from benchmarks.measure import Measured

    Entry = dict[str, Any]

MODES = ("at rest", "in a move", "settling")
MOST_APART_MA = 0.01
"""First inputs that differ by more are not solutions of one problem."""


def summarize(cases: Sequence[Measured]) -> dict[str, Any]:
    """Return the figures of all cases.

    Raises:
        RuntimeError: two repeats of a case differ, or another program has solved another problem.
    """
    check_bits(cases)
    document = {
        "cycles": list(_by_mode(cases)),
        "plans": list(_plans(cases)),
        "bus": list(_bus(cases)),
        "valves": list(_valves(cases)),
        "simulation": list(_simulation(cases)),
    }
    for plan in document["plans"]:
        if not plan["apart_ma"] <= MOST_APART_MA:
            raise RuntimeError(f"{plan['program']} plans other inputs than ours, by up to {plan['apart_ma']:.3f} mA")
    return document | {"goals": [asdict(goal) | {"holds": goal.holds} for goal in goals(document)]}


def check_bits(cases: Sequence[Measured]) -> None:
    """Check that every repeat of a case gave the same results, in every build.

    Raises:
        RuntimeError: two repeats differ.
    """
    first: dict[str, str] = {}
    for case in cases:
        for result in case.results:
            if result != first.setdefault(case.name, result):
                raise RuntimeError(f"{case.name}: two repeats gave different results; a repeat must be bit-identical")


def _of(cases: Sequence[Measured], kind: str) -> Iterator[tuple[list[str], Measured]]:
    """Yield the cases of a kind, each with the other parts of its name."""
    for case in cases:
        own, *parts = case.name.split(", ")
        if own == kind:
            yield parts, case


def _figures(group: Sequence[Measured], label: str) -> Entry:
    """Return the distributions over the actions with `label`: of their smallest durations, and of all durations."""
    least = [duration for case in group for duration in case.smallest_ns(label)]
    every = [duration for case in group for duration in case.all_ns(label)]
    return {"smallest": asdict(Distribution.of(least)), "raw": asdict(Distribution.of(every)), "smallest_ns": least}


def _by_mode(cases: Sequence[Measured]) -> Iterator[Entry]:
    groups: dict[tuple[str, str], list[Measured]] = {}
    for (value, *_), case in _of(cases, "cycle"):
        groups.setdefault((value, case.build), []).append(case)
    for (value, build), group in groups.items():
        for mode in MODES:
            yield {"rate": value, "build": build, "mode": mode} | _figures(group, mode)


def _plans(cases: Sequence[Measured]) -> Iterator[Entry]:
    ours: list[float] = next(
        (json.loads(case.results[0]) for (name,), case in _of(cases, "plan") if name == "ours"), []
    )
    for (program,), case in _of(cases, "plan"):
        first_ma = json.loads(case.results[0])
        pairs = [(a, b) for a, b in zip(first_ma, ours, strict=True) if a is not None and b is not None]
        yield {
            "program": program,
            "build": case.build if program == "ours" else "",
            "unsolved": sum(value is None for value in first_ma),
            "apart_ma": max((abs(a - b) for a, b in pairs), default=math.inf),
        } | _figures([case], "plan")


def _bus(cases: Sequence[Measured]) -> Iterator[Entry]:
    for (bus, kind), case in _of(cases, "bus"):
        for mode in MODES:
            yield {"bus": bus, "kind": kind, "build": case.build, "mode": mode} | _figures([case], mode)


def _valves(cases: Sequence[Measured]) -> Iterator[Entry]:
    for (count,), case in _of(cases, "valves"):
        periods_ns = case.smallest_ns("period")
        mean_us = fmean(periods_ns) / int(count) / 1e3
        yield {
            "valves": int(count),
            "build": case.build,
            "mean_us": mean_us,
            "valves_per_core": PERIOD_NS / 1e3 / mean_us,
            "period": asdict(Distribution.of(periods_ns)),
        }


def _simulation(cases: Sequence[Measured]) -> Iterator[Entry]:
    duration_s = load_scenario(SCENARIO).duration_s
    for (way,), case in _of(cases, "simulation"):
        (took_ns,) = case.smallest_ns("run")
        yield {"way": way, "build": case.build, "scenario": SCENARIO, "times_real_time": duration_s / (took_ns / 1e9)}
