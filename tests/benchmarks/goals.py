"""The goals, and whether the figures hold them. A goal that is missed is printed; it fails nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

_CYCLES = (
    ("best", "at rest", "median", 50.0),
    ("best", "at rest", "p99", 100.0),
    ("best", "in a move", "p99", 150.0),
    ("best", "in a move", "largest", 250.0),
    ("interpreted", "in a move", "p99", 700.0),
)
"""Build, mode, quantile, and the most µs on a valve without lag."""
LAGGED_P99_US = 500.0
"""The most µs of the p99 of every mode, compiled, at 1 kHz on a valve with lag."""
_RATIOS = (("do-mpc", 50.0), ("qpmpc + daqp", 5.0), ("qpmpc + OSQP", 5.0))
"""Another program, and the least ratio of its median to ours."""
_SIMULATIONS = (("frames", 12.0), ("direct", 30.0))
"""The way of a simulation, and the least times real time."""


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


def goals(document: dict[str, Any]) -> Iterator[Goal]:
    """Yield the goals that the figures decide; `best` is the compiled build, where there is one."""
    builds = {entry["build"] for entry in document["cycles"]}
    best = "compiled" if "compiled" in builds else "interpreted"
    yield from _of_cycles(document["cycles"], best)
    medians = {(entry["program"], entry["build"]): entry["smallest"]["median"] for entry in document["plans"]}
    for program, ratio in _RATIOS:
        if (program, "") in medians:
            measured = medians[program, ""] / medians["ours", best]
            yield Goal(f"plan, {program}: median, times ours", ratio, measured, least=True)
    for way, ratio in _SIMULATIONS:
        for entry in document["simulation"]:
            if entry["way"] == way:
                what = f"simulation, {way}, {entry['build']}: times real time"
                yield Goal(what, ratio, entry["times_real_time"], least=True)


def is_lagged(entry: dict[str, Any]) -> bool:
    """Return whether the cycles of this entry are those of a valve with lag."""
    return "lag" in entry["rate"]


def _of_cycles(cycles: list[dict[str, Any]], best: str) -> Iterator[Goal]:
    for wanted, mode, quantile, limit_us in _CYCLES:
        for entry in cycles:
            if (entry["build"], entry["mode"]) == (best if wanted == "best" else wanted, mode) and not is_lagged(entry):
                yield _of_cycle(entry, quantile, limit_us)
    for entry in cycles:
        if entry["build"] == best and is_lagged(entry):
            yield _of_cycle(entry, "p99", LAGGED_P99_US)


def _of_cycle(entry: dict[str, Any], quantile: str, limit_us: float) -> Goal:
    what = f"cycle {entry['mode']}, {entry['rate']}, {entry['build']}: {quantile}, µs"
    return Goal(what, limit_us, entry["smallest"][quantile])
