"""What a delay from the reading to its command costs the law `nmpc`, with and without its knowledge of the delay.

python -m benchmarks.command_delay
"""

from __future__ import annotations

import sys
from contextlib import nullcontext
from dataclasses import replace as changed
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

from tqdm import tqdm

from positioner.bench import metrics
from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.scenario import Scenario, load_scenario
from positioner.config.schema import Configuration

if TYPE_CHECKING:
    from positioner.laws.law import Law

PARTS = (0.0, 0.2, 0.5, 0.8, 1.0)
SEEDS = (1, 2, 3, 4)
_make = Configuration.make_law


def without_delay(configuration: Configuration, *, plays: bool = False) -> Law[Any]:
    """Return the law of a configuration without its delay."""
    return _make(changed(configuration, control=changed(configuration.control, command_delay_s=0.0)), plays=plays)


def figures(scenario: Scenario, *, known: bool) -> metrics.Totals:
    """Return the figures of a run without a bus, whose law knows the delay or not."""
    with nullcontext() if known else patch.object(Configuration, "make_law", without_delay):
        recording = run_in_process(scenario).recording
    span_m = configure(scenario).valve.span_m
    return metrics.totals(metrics.dwell_metrics(recording.trace, scenario.dwell_edges_s, span_m))


def main() -> None:
    """Print a row for each delay, known to the law and not: the largest over the seeds."""
    paper = load_scenario("paper-valve")
    rows = [(part, known) for part in PARTS for known in (True, False) if part or known]
    sys.stdout.write("delay  known  worst error %  unsettled  travel\n")
    for part, known in tqdm(rows, leave=False, disable=None):
        control = {"command_delay_s": part * paper.sample_period_s}
        found = [figures(changed(paper, seed=seed, control=control), known=known) for seed in SEEDS]
        error = max(each.worst_mean_abs_error_pct for each in found)
        travel = max(each.travel_ratio or 0.0 for each in found)
        unsettled = sum(each.unsettled_1pct for each in found)
        sys.stdout.write(f"{part:5.1f}  {'yes' if known else 'no':5}  {error:13.2f}  {unsettled:9d}  {travel:6.2f}\n")


if __name__ == "__main__":
    main()
