"""What was measured, as one document: distributions by mode, plans beside those of the other programs, goals."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from benchmarks.distribution import Distribution

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from benchmarks.measure import Measured

MODES = ("at rest", "in a move", "settling")
MOST_APART_MA = 0.01
"""First inputs that differ by more are not solutions of one problem."""


@dataclass(frozen=True, slots=True)
class Goal:
    """A limit in µs, or a least ratio, and what was measured."""

    what: str
    limit: float
    measured: float
    least: bool = False

    @property
    def holds(self) -> bool:
        """Whether the goal is met."""
        return self.measured >= self.limit if self.least else self.measured <= self.limit


def summarize(cases: Sequence[Measured]) -> dict[str, Any]:
    """Return the figures of all cases."""
    check_bits(cases)
    cycles, plans = list(_cycles(cases)), list(_plans(cases))
    return {
        "cycles": cycles,
        "plans": plans,
        "goals": [asdict(goal) | {"holds": goal.holds} for goal in goals(cycles, plans)],
    }


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


def _cycles(cases: Sequence[Measured]) -> Iterator[dict[str, Any]]:
    groups: dict[tuple[str, str], list[Measured]] = {}
    for case in cases:
        if case.name.startswith("cycle "):
            _, number, unit, *_ = case.name.split()
            groups.setdefault((case.build, f"{number} {unit}"), []).append(case)
    for (build, rate), group in groups.items():
        for mode in MODES:
            least = [duration for case in group for duration in case.smallest_ns(mode)]
            every = [duration for case in group for duration in case.all_ns(mode)]
            yield {
                "build": build,
                "rate": rate,
                "mode": mode,
                "smallest": asdict(Distribution.of(least)),
                "raw": asdict(Distribution.of(every)),
                "smallest_ns": least,
            }


def _plans(cases: Sequence[Measured]) -> Iterator[dict[str, Any]]:
    plans = [case for case in cases if case.name.startswith("plan ")]
    ours = {case.name: case for case in plans if case.name.endswith(" ours")}
    for case in plans:
        _, _, horizon, program = case.name.split(maxsplit=3)
        first_ma = json.loads(case.results[0])
        reference_ma = json.loads(ours[f"plan H_p {horizon} ours"].results[0])
        pairs = [(a, b) for a, b in zip(first_ma, reference_ma, strict=True) if a is not None and b is not None]
        least, every = case.smallest_ns("plan"), case.all_ns("plan")
        yield {
            "build": case.build,
            "horizon": int(horizon),
            "program": program,
            "smallest": asdict(Distribution.of(least)),
            "raw": asdict(Distribution.of(every)),
            "unsolved": sum(value is None for value in first_ma),
            "apart_ma": max((abs(a - b) for a, b in pairs), default=math.inf),
        }


def goals(cycles: Sequence[dict[str, Any]], plans: Sequence[dict[str, Any]]) -> Iterator[Goal]:
    """Yield the goals that these figures decide."""
    best = "compiled" if any(entry["build"] == "compiled" for entry in cycles) else "interpreted"
    limits = (
        (best, "at rest", "median", 50.0),
        (best, "at rest", "p99", 100.0),
        (best, "in a move", "p99", 150.0),
        (best, "in a move", "largest", 250.0),
        ("interpreted", "in a move", "p99", 700.0),
    )
    for build, mode, quantile, limit in limits:
        for entry in cycles:
            if (entry["build"], entry["mode"]) == (build, mode):
                what = f"a cycle {mode} at {entry['rate']}, {build}: {quantile}, µs"
                yield Goal(what, limit, entry["smallest"][quantile])
    ours = {entry["horizon"]: entry for entry in plans if (entry["program"], entry["build"]) == ("ours", best)}
    for program, ratio in (("do-mpc", 50.0), ("qpmpc + daqp", 5.0), ("qpmpc + OSQP", 5.0)):
        for entry in plans:
            if (entry["program"], entry["horizon"]) == (program, 20):
                measured = entry["smallest"]["median"] / ours[20]["smallest"]["median"]
                yield Goal(f"a plan at H_p 20: {program}, medians, times ours", ratio, measured, least=True)
