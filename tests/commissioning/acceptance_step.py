"""How exactly `positioner step-test` measures emulated valves: a part of `make diagnostics-test`.

The true positions are the truth, and in open loop the friction and the poles of the paper's valve. Noise of 0.05 % of
span: medians of Td, T63 and T86 within 1 sample, overshoot within 1 point, for steps of 1 % and more, 5 repeats. Noise
of 2 % of the reading: within 3 samples for 10 % and more, 20 repeats. Dead band and resolution within a step of the
ladder, and within 0.02 % without noise by a ladder of 0.02 %.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from collections import defaultdict
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from goal_table import show
from step_plant import CLEAN, HIGH, LOW, Played, make_test, play
from tqdm import tqdm

from positioner.commissioning.step.ladder import Phase
from positioner.commissioning.step.memory import Doing
from positioner.commissioning.step.result import StepResult, result_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

BREAKAWAY_N, SLIDING_N, SIGNAL_N = 1707.7, 1423.0, 16.0 * 333.637
OPEN_T86_S = 0.02101
LEVELS = {"T63": 0.632, "T86": 0.865}
FIELDS = {"Td": "dead_time_s", "T63": "t63_s", "T86": "t86_s"}


@dataclass(frozen=True)
class Case:
    """One test: what it is about, the valve, noise, law, seed, and the plan."""

    name: str
    preset: str
    sensor: tuple[tuple[str, float], ...]
    law: str
    seed: int
    sizes: tuple[float, ...]
    repeats: int
    wait_s: float
    ladder: float


def cases(*, short: bool, later: int = 0) -> list[Case]:
    """Return the tests; `later` is added to each seed."""
    low, high, clean = (tuple(each.items()) for each in (LOW, HIGH, CLEAN))
    found = [
        Case("A", "paper", low, "nmpc", 301, (0.01, 0.1), 5, 2.0, 0.001),
        Case("open", "paper", low, "hold", 302, (0.65, 0.8), 3, 1.0, 0.005),
    ]
    if short:
        return found
    found += [Case("A", "paper", low, "nmpc", seed, (0.01, 0.02, 0.05, 0.1, 0.2), 5, 2.0, 0.001) for seed in (310, 311)]
    found += [Case("A", "graphite", low, "nmpc", seed, (0.01, 0.02, 0.05, 0.1), 5, 2.6, 0.002) for seed in (320, 321)]
    found += [Case("A", "paper", low, "pi", seed, (0.1, 0.2), 5, 4.0, 0.0) for seed in (330, 331)]
    found += [Case("B", "paper", high, "nmpc", seed, (0.1, 0.2), 20, 2.0, 0.0) for seed in (340, 341, 342)]
    found += [Case("clean", "paper", clean, "nmpc", 350, (0.1,), 1, 2.0, 0.0002)]
    found += [Case("clean open", "paper", clean, "hold", 351, (0.8,), 1, 0.4, 0.0002)]
    found += [Case("open", "paper", low, "hold", seed, (0.65, 0.8), 5, 1.0, 0.005) for seed in (360, 361)]
    return [replace(each, seed=each.seed + later) for each in found]


def passed(gone: NDArray[np.float64], level_m: float) -> float:
    """Return the sample, with its fraction, at which a true position first lies beyond a level."""
    after = int(np.argmax(gone > level_m))
    if after == 0:
        return 0.0
    return float(after - 1 + (level_m - gone[after - 1]) / (gone[after] - gone[after - 1]))


def step_errors(played: Played, result: StepResult) -> Iterator[tuple[str, float]]:
    """Yield the error of each median: in samples, of the overshoot in points."""
    truths: dict[tuple[float, float], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for response, (before_m, final_m, after_m) in zip(played.memory.responses, played.true_steps(), strict=True):
        gone, step_m = response.direction * (after_m - before_m), response.direction * (final_m - before_m)
        own = truths[response.size, response.direction]
        own["Td"].append(passed(gone, result.dead_time_m))
        for name, part in LEVELS.items():
            own[name].append(passed(gone, part * step_m))
        own["overshoot"].append(100.0 * max(float(gone.max()) / step_m - 1.0, 0.0))
    for row in result.rows:
        own = truths[row.size, row.direction]
        for name, quantity in FIELDS.items():
            yield name, row.spread(quantity).median / result.period_s - float(np.median(own[name]))
        yield "overshoot", 100.0 * row.spread("overshoot").median - float(np.median(own["overshoot"]))


def ladder_errors(played: Played, result: StepResult) -> Iterator[tuple[str, float]]:
    """Yield how far each fine ladder lies from what the true positions say, in parts of the range of the input."""
    count = round(result.plan.wait_s / result.period_s)
    rungs = iter(result.rungs)
    for sample, memory in played.asked:
        ladder = memory.ladder
        if ladder is None or memory.doing is not Doing.LADDERS or ladder.rung > result.rung:
            continue
        here_m = float(played.true_m[sample + 3 * count // 4 : sample + count].mean())
        if ladder.phase is Phase.AWAY:
            told, found, told_at = next(rungs), [], 0.0
        elif ladder.phase is Phase.ONTO:
            origin = told_at = ladder.level
            rest_m = here_m
        else:
            if ladder.direction * (here_m - rest_m) > result.plan.observable * result.span_m:
                found.append(0.5 * (abs(told_at - origin) + abs(ladder.level - origin)))
                origin, rest_m = ladder.level, here_m
                each = told.dead_band if len(found) == 1 else told.resolution
                if len(found) <= 2 and each is not None:
                    yield (
                        "dead band" if len(found) == 1 else "resolution",
                        0.5 * (each.without + each.moved) - found[-1],
                    )
            told_at = ladder.level


def friction_errors(result: StepResult) -> Iterator[tuple[str, float]]:
    """Yield how far dead band and resolution lie from those of the friction, in parts of the signal."""
    truths = {"dead_band": (BREAKAWAY_N + SLIDING_N) / SIGNAL_N, "resolution": (BREAKAWAY_N - SLIDING_N) / SIGNAL_N}
    for name, truth in truths.items():
        for direction in (1.0, -1.0):
            band = result.band(name, direction)
            assert band is not None
            yield name.replace("_", " "), band.median - truth


def run(case: Case) -> tuple[Case, list[tuple[str, float]]]:
    """Return the errors of a test, with the names of their goals."""
    sensor = dict(case.sensor)
    test = make_test(
        case.preset,
        sensor,
        case.law,
        sizes=case.sizes,
        repeats=case.repeats,
        wait_s=case.wait_s,
        ladder=case.ladder,
    )
    played = play(test, case.preset, sensor, case.seed)
    result = result_of(played.memory, test)
    errors = [] if case.name.startswith("clean") else list(step_errors(played, result))
    if case.law == "hold":
        errors += friction_errors(result)
        errors += [("T86 of the poles", (row.spread("t86_s").median - OPEN_T86_S) / 1e-3) for row in result.rows]
    elif case.ladder:
        errors += [
            (name, error / (1.0 if case.name == "clean" else result.rung))
            for name, error in ladder_errors(played, result)
        ]
    return case, errors


GOALS = (
    ("A", ("Td", "T63", "T86"), 1.0, 1.0, "samples"),
    ("A", ("overshoot",), 1.0, 1.0, "points"),
    ("B", ("Td", "T63", "T86"), 3.0, 1.0, "samples"),
    ("A", ("dead band", "resolution"), 1.0, 1.0, "steps of the ladder"),
    ("clean", ("dead band", "resolution"), 0.02, 100.0, "% of span"),
    ("clean open", ("dead band", "resolution"), 0.02, 100.0, "% of signal"),
    ("open", ("Td", "T63", "T86"), 1.0, 1.0, "samples"),
    ("open", ("T86 of the poles",), 1.0, 1.0, "samples from 21.0 ms"),
    ("open", ("dead band", "resolution"), 0.5, 100.0, "% of signal"),
)
"""Case, quantities, the largest error, its factor and its unit."""


TITLES = {
    "A": "closed loop, 0.05 % noise",
    "B": "closed loop, 2 % noise",
    "clean": "closed loop, no noise",
    "clean open": "open loop, no noise",
    "open": "open loop, 0.05 % noise",
}


def rows(found: Mapping[tuple[str, str], list[float]]) -> Iterator[tuple[str, str, str, bool]]:
    """Yield quantity, goal, figure and whether it is met."""
    for case_name, names, goal, factor, unit in GOALS:
        for name in names:
            values = [factor * each for each in found[case_name, name]]
            if values:
                met = max(abs(value) for value in values) <= goal + 1e-9
                figure = f"{min(values):+.3f} to {max(values):+.3f} ({len(values)} medians)"
                yield f"{TITLES[case_name]}: {name}", f"± {goal:g} {unit}", figure, met


def main() -> int:
    """Print a row for each goal; return 1 where one is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="one test in closed loop and one in open loop")
    parser.add_argument("--workers", type=int, default=multiprocessing.cpu_count())
    parser.add_argument("--seed", type=int, default=0, help="add to each seed (default: %(default)s)")
    arguments = parser.parse_args()
    chosen = cases(short=arguments.short, later=arguments.seed)
    found: dict[tuple[str, str], list[float]] = defaultdict(list)
    with multiprocessing.Pool(arguments.workers) as pool:
        for case, errors in tqdm(pool.imap_unordered(run, chosen), total=len(chosen), unit=" tests", disable=None):
            for name, error in errors:
                found[case.name, name].append(error)
    return show(rows(found))


if __name__ == "__main__":
    sys.exit(main())
