"""`positioner reach` against a closed loop: duration and error of an opening or closing by a tenth of the span.

    PYTHONPATH=tests python -m benchmarks.reach_durations [--setpoints 31] [--dwell 3]

The emulated valve is the paper's, with each lag of the league on real valves and both noises; the law knows both. A
duration is until the true stem is within 1 % of span and stays there. The table is printed as Markdown.
"""

from __future__ import annotations

import argparse
import statistics
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from benchmarks.tables import table
from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.scenario import Scenario
from positioner.reach.case import Case
from positioner.reach.figures import MOVE_OF_SPAN, figures_of
from positioner.reach.moves import SETTLED_OF_SPAN
from positioner.studies.real_valves.valves import LAGS_S, NOISE_NAMES, NOISES, lag_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.reach.figures import Figures

_LOW_MM, _SPAN_MM = 70.0, 127.0
_LAST_S = 0.3


@dataclass(frozen=True, slots=True)
class Measured:
    """Durations in s of the dwells, and the mean error in m of their last 0.3 s."""

    durations_s: tuple[float, ...]
    error_m: float


def scenario(lag_s: float, noise: str, setpoints: int, dwell_s: float) -> Scenario:
    """Return moves to and fro by a tenth of the span, on a valve with this lag and noise."""
    places = (_LOW_MM, _LOW_MM + MOVE_OF_SPAN * _SPAN_MM)
    return Scenario(
        name="reach",
        title="moves by a tenth of the span",
        law="nmpc",
        seed=11,
        setpoints_mm=tuple(places[number % 2] for number in range(setpoints)),
        dwell_s=dwell_s,
        plant={"preset": "paper", "actuator": lag_table(lag_s), "sensor": dict(NOISES[noise])},
        valve={"actuator": lag_table(lag_s)},
        estimator=dict(NOISES[noise]),
    )


def played(wanted: Scenario) -> Measured:
    """Return what the moves of a closed loop take; the first dwell is left out."""
    run = run_in_process(wanted)
    count, samples = len(wanted.setpoints_mm), round(wanted.dwell_s / wanted.sample_period_s)
    goal_m = np.repeat(np.array(wanted.setpoints_mm) * 1e-3, samples)
    error_m = np.abs(run.recording.true_position_m - goal_m).reshape(count, samples)[1:]
    outside = error_m > SETTLED_OF_SPAN * _SPAN_MM * 1e-3
    ends = [int(np.flatnonzero(dwell)[-1]) + 1 for dwell in outside]
    left_m = float(error_m[:, -round(_LAST_S / wanted.sample_period_s) :].mean())
    return Measured(tuple(end * wanted.sample_period_s for end in ends), left_m)


def main(arguments: Sequence[str]) -> None:
    """Play all, and print the table."""
    parser = argparse.ArgumentParser(prog="benchmarks.reach_durations")
    parser.add_argument("--setpoints", type=int, default=31, help="setpoints of each cell (default: 31)")
    parser.add_argument("--dwell", type=float, default=3.0, help="seconds at each (default: 3)")
    given = parser.parse_args(arguments)
    rows = []
    for noise, name in NOISE_NAMES.items():
        for lag_s in tqdm(LAGS_S, desc=name, leave=False):
            wanted = scenario(lag_s, noise, given.setpoints, given.dwell)
            rows.append((name, f"{lag_s * 1e3:g}", *_columns(figures_of(Case.of(configure(wanted))), played(wanted))))
    sys.stdout.write("\n".join(table(_HEAD, rows)) + "\n")


_HEAD = (
    "noise",
    "lag, ms",
    "shortest, ms",
    "median, ms",
    "measured",
    "mean, ms",
    "measured",
    "corrected",
    "measured",
    "error, %",
    "measured",
)


def _columns(told: Figures, found: Measured) -> tuple[str, ...]:
    """Return the shortest duration, then each figure as computed and as measured."""
    median_s, mean_s = statistics.median(found.durations_s), statistics.fmean(found.durations_s)
    corrected = sum(duration_s > _CORRECTED * median_s for duration_s in found.durations_s) / len(found.durations_s)
    per_span = 1e5 / _SPAN_MM
    pairs = (
        (f"{told.law_s * 1e3:.0f}", f"{median_s * 1e3:.0f}"),
        (f"{told.mean_s * 1e3:.0f}", f"{mean_s * 1e3:.0f}"),
        (f"{told.share:.0%}", f"{corrected:.0%}"),
        (f"{told.error_m * per_span:.3f}", f"{found.error_m * per_span:.3f}"),
    )
    return (f"{told.shortest_s * 1e3:.0f}", *(text for pair in pairs for text in pair))


_CORRECTED = 1.2
"""A dwell that lasts longer than so many medians needed a correction."""

if __name__ == "__main__":
    main(sys.argv[1:])
