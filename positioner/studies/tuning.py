"""Tuning a law by seeded random search on the nominal valve, so that rival laws are compared at their best. Shell.

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
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import tomli_w
from tqdm import tqdm

from positioner.bench.scenario import Scenario
from positioner.laws.tuned import table_name
from positioner.studies.direct import play_directly

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.bench.metrics import DwellMetrics
    from positioner.studies.pool import Pool

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
_DIGITS = 4
"""Significant digits of a value: the stored value is the one that was tried."""


@dataclass(frozen=True, slots=True)
class Range:
    """One parameter: its dotted key under the law's table, and its limits; `or_none`: half of the candidates have 0."""

    key: str
    low: float
    high: float
    or_none: bool = False


@dataclass(frozen=True, slots=True)
class Search:
    """The parameters of a law that are tuned, and those that are fixed."""

    ranges: tuple[Range, ...]
    fixed: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Tuning:
    """Result of a search; `values` belong to the ranges of the law's search, `first_cost` to the first candidate."""

    law: str
    budget: int
    seed: int
    values: tuple[float, ...]
    cost: float
    first_cost: float


def _pid(prefix: str) -> tuple[Range, ...]:
    return (
        Range(f"{prefix}proportional_gain_ma_per_m", 5.0, 2000.0),
        Range(f"{prefix}integral_gain_ma_per_m_s", 50.0, 50000.0),
        Range(f"{prefix}derivative_gain_ma_s_per_m", 1e-3, 3.0, or_none=True),
        Range(f"{prefix}filter_time_constant_s", 5e-4, 0.1),
    )


_OFF_BAND = Range("off_band_m", 1e-4, 5e-3, or_none=True)

SEARCHES: Mapping[str, Search] = MappingProxyType(
    {
        "pi": Search(_pid("")),
        "pi-deadband": Search((*_pid("pid."), Range("deadband_m", 2e-4, 6e-3))),
        "knocker": Search(
            (
                *_pid("pid."),
                Range("pulse_amplitude_ma", 0.3, 8.0),
                Range("pulse_width_s", 0.002, 0.1),
                Range("pulse_period_s", 0.005, 0.3),
                _OFF_BAND,
            )
        ),
        "constant-reinforcement": Search((*_pid("pid."), Range("reinforcement_ma", 0.3, 8.0), _OFF_BAND)),
        "two-move": Search((Range("move_s", 0.02, 0.12), Range("back_off_m", 0.007, 0.016))),
        # on the nominal valve a move is never repeated, so the parameters of retries cannot be tuned there
        "two-move-retry": Search(
            (Range("moves.move_s", 0.02, 0.12),),
            (
                ("moves.back_off_m", 0.012),
                ("averaging_s", 0.15),
                ("tolerance_m", 0.0005),
                ("most_retries", 8),
                ("learning_gain", 1.0),
            ),
        ),
    }
)
"""Every law that can be tuned."""


def tune(law: str, budget: int, seed: int, pool: Pool) -> Tuning:
    """Return the best of `budget` candidates; the same arguments give the same answer, whatever the pool.

    As many candidates as the pool has workers are tried at once. When one of them is the best so far, those after it
    that vary the best one before are tried again.
    """
    search = SEARCHES[law]
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
            for each, cost in zip(values, _costs(law, values, seed, best_cost, pool), strict=True):
                first_cost = cost if number == 0 else first_cost
                number += 1
                bar.update()
                if cost < best_cost:
                    best, best_cost = each, cost
                    bar.set_postfix_str(f"cost {cost:.3f}")
                    if number > exploring:
                        break
    return Tuning(law, budget, seed, best, best_cost, first_cost)


def _costs(law: str, values: list[tuple[float, ...]], seed: int, limit: float, pool: Pool) -> list[float]:
    """Return the cost of each candidate; infinity where it is sure to reach `limit`."""
    items = [(place, scenario_of(law, each, seed), limit) for place, each in enumerate(values)]
    found = {place: cost for (place, _, _), cost in pool.results(_cost, items)}
    return [found[place] for place in range(len(values))]


def _cost(item: tuple[int, Scenario, float]) -> float:
    _, scenario, limit = item
    return cost_of(scenario, limit)


def cost_of(scenario: Scenario, limit: float = math.inf) -> float:
    """Return the mean cost of the dwells of `scenario`; infinity as soon as it is sure to reach `limit`."""
    total, dwells = 0.0, len(scenario.visited_mm)
    for dwell in play_directly(scenario):
        total += dwell_cost(dwell)
        if total / dwells >= limit:
            return math.inf
    return total / dwells


def dwell_cost(dwell: DwellMetrics) -> float:
    """Return J of one dwell."""
    return dwell.iae_mm_s + dwell.mean_abs_error_pct + 0.001 * dwell.command_variation_ma + 0.04 * dwell.reversals


def scenario_of(law: str, values: tuple[float, ...], seed: int) -> Scenario:
    """Return the scenario of a candidate: the nominal valve at 1 kHz, its noise 2 % of the reading."""
    return Scenario(
        name="tuning",
        title=f"{law}, a candidate",
        law=law,
        seed=seed,
        setpoints_mm=SETPOINTS_MM,
        visits=VISITS,
        dwell_s=DWELL_S,
        plant={"preset": _TUNED_ON},
        control=control_table(law, values),
    )


def control_table(law: str, values: tuple[float, ...]) -> dict[str, Any]:
    """Return the `[control]` table of a configuration in which `law` has the parameters `values`."""
    search = SEARCHES[law]
    table: dict[str, Any] = {}
    named = [(each.key, value) for each, value in zip(search.ranges, values, strict=True)]
    for key, value in (*search.fixed, *named):
        group, _, name = key.rpartition(".")
        (table.setdefault(group, {}) if group else table)[name] = value
    return {table_name(law): table}


def to_toml(tuning: Tuning) -> str:
    """Return a complete configuration: the nominal valve, the law, and its parameters.

    The packaged parameters are such files; a comment gives the command that found them.
    """
    how = f"# positioner tune {tuning.law} --budget {tuning.budget} --seed {tuning.seed}\n# cost {tuning.cost:.4f}\n"
    control = {"law": tuning.law, **control_table(tuning.law, tuning.values)}
    return how + tomli_w.dumps({"valve": {"id": "tuned", "preset": _TUNED_ON}, "control": control})


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
