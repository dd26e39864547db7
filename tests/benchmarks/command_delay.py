"""What a delay from the reading to its command costs the law `nmpc`, with and without its knowledge of the delay.

python -m benchmarks.command_delay
"""

from __future__ import annotations

import sys
from contextlib import ExitStack, contextmanager
from dataclasses import replace as changed
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

from tqdm import tqdm

from positioner.bench import metrics
from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.scenario import Scenario, load_scenario
from positioner.config.schema import Configuration
from positioner.cycle import control
from positioner.values import replace

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.laws.law import Law, Observation

PARTS = (0.0, 0.2, 0.5, 0.8, 1.0)
SEEDS = (1, 2, 3, 4)
KNOWN, UNKNOWN, MEAN = "known to the law", "unknown", "unknown, mean current"


@contextmanager
def told(what: str, delay_part: float) -> Iterator[None]:
    """Let the law know the delay, or not; or give it the mean of the currents that acted between two readings."""
    make, observe = Configuration.make_law, control._observation
    before_ma: list[float] = []

    def without_delay(configuration: Configuration) -> Law[Any]:
        return make(changed(configuration, control=changed(configuration.control, command_delay_s=0.0)))

    def with_mean(*arguments: Any) -> Observation:
        seen = observe(*arguments)
        before_ma.append(seen.applied_ma)
        old_ma = before_ma[-2:][0]
        return replace(seen, applied_ma=delay_part * old_ma + (1.0 - delay_part) * seen.applied_ma)

    with ExitStack() as stack:
        if what != KNOWN:
            stack.enter_context(patch.object(Configuration, "make_law", without_delay))
        if what == MEAN:
            stack.enter_context(patch.object(control, "_observation", with_mean))
        yield


def figures(scenario: Scenario) -> metrics.Totals:
    """Return the figures of a run without a bus."""
    recording = run_in_process(scenario).recording
    span_m = configure(scenario).valve.span_m
    return metrics.totals(metrics.dwell_metrics(recording.trace, scenario.dwell_edges_s, span_m))


def main() -> None:
    """Print a row for each delay and kind of knowledge: the largest over the seeds."""
    paper = load_scenario("paper-valve")
    rows = [(part, what) for part in PARTS for what in (KNOWN, UNKNOWN, MEAN) if part or what == KNOWN]
    sys.stdout.write("delay  the delay is           worst error %  unsettled  travel\n")
    for part, what in tqdm(rows, leave=False, disable=None):
        delay_s = part * paper.sample_period_s
        with told(what, part):
            found = [figures(changed(paper, seed=seed, control={"command_delay_s": delay_s})) for seed in SEEDS]
        error = max(each.worst_mean_abs_error_pct for each in found)
        travel = max(each.travel_ratio or 0.0 for each in found)
        unsettled = sum(each.unsettled_1pct for each in found)
        sys.stdout.write(f"{part:5.1f}  {what:22} {error:13.2f}  {unsettled:9d}  {travel:6.2f}\n")


if __name__ == "__main__":
    main()
