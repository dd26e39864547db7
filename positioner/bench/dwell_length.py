"""Whether the dwells of a bench were long enough for the valve, and how long they should be. Pure.

The error of a dwell is the mean over its last part (`metrics.ERROR_WINDOW_S`). Where the stem still moves then, the
figure is of a move, not of the place where the law leaves the stem. How long `nmpc` needs is computed with its model of
the valve, as `positioner reach` does: the largest move, one correction, and the part of which the error is the mean.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.bench.metrics import ERROR_WINDOW_S
from positioner.reach.case import Case
from positioner.reach.expected import corrections
from positioner.reach.moves import durations

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.bench.metrics import DwellMetrics
    from positioner.bench.scenario import Scenario
    from positioner.config.schema import Configuration

_PREDICTED = "nmpc"
"""The law whose moves `reach` computes."""
_OF_RANGE = 0.8
"""The largest move that is computed, as a part of the range: at its ends nothing is left to accelerate the stem."""
_STEP_S = 0.5
"""An advised dwell is a multiple of it."""


def dwell_notes(scenario: Scenario, configuration: Configuration, dwells: Sequence[DwellMetrics]) -> tuple[str, ...]:
    """Return what is to be said of the length of the dwells; nothing where the stem was within 1 % in time."""
    if scenario.edges_s:  # setpoints that move
        return ()
    dwell_s = scenario.dwell_s
    window_s = min(ERROR_WINDOW_S, dwell_s / 2.0)
    never = sum(dwell.settle_1pct_s is None for dwell in dwells)
    late = sum(dwell.settle_1pct_s is not None and dwell.settle_1pct_s > dwell_s - window_s for dwell in dwells)
    measured = f"outside of 1 % of span in its last {window_s:g} s, of which the error is the mean"
    if scenario.law != _PREDICTED:  # one that has never come within 1 % may never do
        advice = f"--dwell {_advised_s(scenario, 2.0 * dwell_s):g} shows the error at rest"
        return (f"in {late} of {len(dwells)} dwells the stem was still {measured}: {advice}",) if late else ()
    if not never + late:
        return ()
    needed_s = _needed_s(Case.of(configuration), max(dwell.ideal_travel_mm for dwell in dwells) * 1e-3) + window_s
    advice = f"--dwell {_advised_s(scenario, max(2.0 * dwell_s, needed_s)):g}"
    counted = f"in {never + late} of {len(dwells)} dwells the stem was {measured}"
    predicted = f"by its model the largest move, one correction and that part take {needed_s:.1f} s"
    if needed_s > dwell_s:
        return f"{dwell_s:g} s are too short for this valve: {counted}", f"{predicted}: play it with {advice}"
    why = "the plant differs from the configuration, or the law still learns it"
    return counted, f"{predicted}: {why}; {advice} shows which"


def _needed_s(case: Case, move_m: float) -> float:
    """Return how long a move and one correction take, in s; `reach` computes moves around the middle of the range."""
    low_m, high_m = case.valve.restartable_m(case.low_ma, case.high_ma)
    move_m = min(move_m, _OF_RANGE * (high_m - low_m))
    moved_s = durations(case, move_m).law_s + corrections(case).correction_s
    return moved_s if math.isfinite(moved_s) else 0.0  # a current too weak for the move: no dwell is long enough


def _advised_s(scenario: Scenario, at_least_s: float) -> float:
    """Return a dwell in s of this length or a little more, which the period of the setpoints divides."""
    step_s = scenario.setpoint_period_s * math.ceil(_STEP_S / scenario.setpoint_period_s - 1e-9)
    return step_s * math.ceil(at_least_s / step_s - 1e-9)
