"""Tuning a law by seeded random search on one valve, so that rival laws are compared at their best. Shell.

The first half of the budget explores, log-uniformly between wide limits; the second half varies the best candidate. The
cost of a candidate is the mean over dwells of

    J = IAE / (mm s) + mean |e| at the end / % + 0.001 · command variation / mA + 0.04 · reversals

with dwells of 4 s: on shorter dwells the limit cycle of an integral against static friction does not develop. Every
setpoint is visited twice: the position at which an integral comes to rest is partly chance, and with few dwells the
best candidate would be the luckiest one. A candidate is dropped as soon as its dwells cost more than all dwells of the
best: this saves time and changes no result.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tomli_w
from tqdm import tqdm

from plant_emulator.plants import plant_named
from positioner.bench.configure import told
from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.metrics import dwell_metrics
from positioner.bench.own_plant import with_plant
from positioner.bench.playable import within_reach
from positioner.bench.scenario import Scenario
from positioner.inputs.plug_in import anchored
from positioner.laws.registry import is_outside
from positioner.studies.direct import play_directly
from positioner.studies.searches import control_table, search_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.bench.metrics import DwellMetrics
    from positioner.studies.pool import Pool
    from positioner.studies.searches import Search

SETPOINTS_MM = (73.0, 87.0, 80.0, 73.5, 81.5, 83.0)
"""Large, medium and small steps in both directions, where the valve can be restarted both ways."""
VISITS = 2
DWELL_S = 4.0
LEAGUE_SEEDS = range(101, 104)
"""Seeds of the league; laws are never tuned on them."""

_EXPLORING = 0.5
"""Share of the budget that explores."""
_STEP = 0.3
"""Standard deviation of a variation, in the logarithm of the value."""
_TUNED_ON = "paper"
_PLACES = (0.413, 0.795, 0.604, 0.426, 0.645, 0.686)
"""The setpoints as parts of the range from which the nominal valve can be restarted: those of other plants."""
_DIGITS = 4
"""Significant digits of a value: the stored value is the one that was tried."""


@dataclass(frozen=True, slots=True)
class Tuning:
    """Result of a search; `values` belong to the ranges of the law's search, `first_cost` to the first candidate."""

    law: str
    budget: int
    seed: int
    values: tuple[float, ...]
    cost: float
    first_cost: float
    plant: str = _TUNED_ON


def tune(law: str, budget: int, seed: int, pool: Pool, plant: str = _TUNED_ON) -> Tuning:
    """Return the best of `budget` candidates; the same arguments give the same answer, whatever the pool.

    The candidates are tried on `plant`.

    As many candidates as the pool has workers are tried at once. When one of them is the best so far, those after it
    that vary the best one before are tried again.
    """
    search = search_of(law)
    on = scenario_on(plant)
    chance = np.random.default_rng(seed)
    exploring = max(1, math.ceil(_EXPLORING * budget))
    explored = [_anywhere(search, chance) for _ in range(exploring)]
    steps = [_steps(search, chance) for _ in range(exploring, budget)]
    best: tuple[float, ...] = ()
    best_cost = first_cost = math.inf
    number = 0
    with tqdm(total=budget, desc=law, unit=" candidates", disable=None) as bar:
        while number < budget:
            values = explored[number : number + pool.size]
            if number >= exploring:
                begin = number - exploring
                values = [_varied(search, best, step) for step in steps[begin : begin + pool.size]]
            for each, cost in zip(values, _costs(law, values, seed, best_cost, pool, on), strict=True):
                first_cost = cost if number == 0 else first_cost
                number += 1
                bar.update()
                if cost < best_cost:
                    best, best_cost = each, cost
                    bar.set_postfix_str(f"cost {cost:.3f}")
                    if number > exploring:
                        break
    return Tuning(law, budget, seed, best, best_cost, first_cost, plant)


def _costs(law: str, values: list[tuple[float, ...]], seed: int, limit: float, pool: Pool, on: Scenario) -> list[float]:
    """Return the cost of each candidate; infinity where it is sure to reach `limit`."""
    items = [(place, scenario_of(law, each, seed, on), limit) for place, each in enumerate(values)]
    found = {place: cost for (place, _, _), cost in pool.results(_cost, items)}
    return [found[place] for place in range(len(values))]


def _cost(item: tuple[int, Scenario, float]) -> float:
    _, scenario, limit = item
    return cost_of(scenario, limit)


def cost_of(scenario: Scenario, limit: float = math.inf) -> float:
    """Return the mean cost of the dwells of `scenario`; infinity as soon as it is sure to reach `limit`."""
    total, dwells = 0.0, len(scenario.visited_mm)
    for dwell in _played(scenario):
        total += dwell_cost(dwell)
        if total / dwells >= limit:
            return math.inf
    return total / dwells


def _played(scenario: Scenario) -> Iterable[DwellMetrics]:
    """Return the figures of every dwell; a law from outside may learn, so it plays behind frames, table and guard."""
    if not is_outside(scenario.law):
        return play_directly(scenario)
    trace = run_in_process(scenario).recording.trace
    return dwell_metrics(trace, scenario.dwell_edges_s, configure(scenario).valve.span_m)


def dwell_cost(dwell: DwellMetrics) -> float:
    """Return J of one dwell."""
    return dwell.iae_mm_s + dwell.mean_abs_error_pct + 0.001 * dwell.command_variation_ma + 0.04 * dwell.reversals


def scenario_on(plant: str) -> Scenario:
    """Return the scenario on which candidates are tried, at 1 kHz; the nominal valve has noise of 2 % of the reading.

    Raises:
        ConfigurationError: there is no such plant.
    """
    scenario = Scenario(
        name="tuning",
        title="a candidate",
        setpoints_mm=SETPOINTS_MM,
        visits=VISITS,
        dwell_s=DWELL_S,
        plant={"preset": _TUNED_ON},
    )
    if plant == _TUNED_ON:
        return scenario
    return with_plant(replace(scenario, setpoints_mm=within_reach(plant_named(plant), _PLACES)), plant)


def scenario_of(law: str, values: tuple[float, ...], seed: int, on: Scenario | None = None) -> Scenario:
    """Return the scenario of a candidate: `on` with this law and seed; without one the nominal valve."""
    return replace(on or scenario_on(_TUNED_ON), law=law, seed=seed, control=control_table(law, values))


def to_toml(tuning: Tuning) -> str:
    """Return a complete configuration: the nominal valve, the law, and its parameters.

    The packaged parameters are such files; a comment gives the command that found them.
    """
    on = "" if tuning.plant == _TUNED_ON else f" --plant {tuning.plant}"
    how = (
        f"# positioner tune {tuning.law}{on} --budget {tuning.budget} --seed {tuning.seed}\n# cost {tuning.cost:.4f}\n"
    )
    control = {"law": anchored(tuning.law, Path.cwd()), **control_table(tuning.law, tuning.values)}
    valve = {"preset": _TUNED_ON} if tuning.plant == _TUNED_ON else told(plant_named(tuning.plant))
    return how + tomli_w.dumps({"valve": {"id": "tuned", **valve}, "control": control})


def _anywhere(search: Search, chance: np.random.Generator) -> tuple[float, ...]:
    drawn = []
    for each in search.ranges:
        value = math.exp(chance.uniform(math.log(each.low), math.log(each.high)))
        absent = chance.random() < 0.5 and each.or_none  # noqa: PLR2004 - every second time
        drawn.append(0.0 if absent else value)
    return _rounded(search, drawn)


def _steps(search: Search, chance: np.random.Generator) -> list[tuple[bool, float]]:
    """Return for each parameter whether a variation keeps it, and the factor by which it varies otherwise."""
    # every second parameter is varied
    return [(chance.random() < 0.5, math.exp(chance.normal(0.0, _STEP))) for _ in search.ranges]  # noqa: PLR2004


def _varied(search: Search, best: tuple[float, ...], steps: list[tuple[bool, float]]) -> tuple[float, ...]:
    varied = []
    for each, value, (stays, factor) in zip(search.ranges, best, steps, strict=True):
        varied.append(value if stays else min(max(value * factor, 0.0 if value == 0.0 else each.low), each.high))
    return _rounded(search, varied)


def _rounded(search: Search, values: list[float]) -> tuple[float, ...]:
    """Return the values as they are written; a pulse longer than its period becomes half the period."""
    keys = [each.key for each in search.ranges]
    if "pulse_width_s" in keys:
        width, period = keys.index("pulse_width_s"), keys.index("pulse_period_s")
        if values[width] > values[period]:
            values[width] = 0.5 * values[period]
    return tuple(float(f"{value:.{_DIGITS}g}") for value in values)
