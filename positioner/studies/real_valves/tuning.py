"""Tuning a rival law for every lag and noise of the league on real valves, by differential evolution. Shell.

Storn and Price (1997), as scipy has it, in the logarithm of each parameter. The first generation holds the packaged
parameters. The cost of a candidate is that of `studies.tuning`, over the nominal and the stochastic plant: on the
nominal one alone, a law that is tuned to its exact parameters would look best.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import tomli_w
from scipy.optimize import differential_evolution
from scipy.stats import qmc
from tqdm import tqdm

from positioner.laws.settings import ControlSettings
from positioner.laws.tuned import table_name
from positioner.studies.real_valves.bouts import RealBout
from positioner.studies.real_valves.conditions import AS_CONFIGURED
from positioner.studies.real_valves.tuned import rival_tables
from positioner.studies.real_valves.valves import NOMINAL, STOCHASTIC
from positioner.studies.searches import SEARCHES, Range
from positioner.studies.tuning import cost_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from positioner.studies.pool import Pool

SETPOINTS = 6
DWELL_S = 3.0
_DWELL_LAGS = 10.0
_MEMBERS = 12
"""Candidates of a generation."""
_HOPELESS = 5.0
"""A candidate is dropped when it is sure to cost so many times what the best one costs."""
_ABSENT = 0.5
"""Width, in e-folds, of the coordinates that stand for 0 where a parameter may be absent."""

_WIDER = {"pulse_width_s": 0.3, "pulse_period_s": 1.0}
"""Upper limits of ranges that a slow actuator needs."""
_RETRIES = (
    Range("averaging_s", 0.02, 0.5),
    Range("tolerance_m", 5e-5, 3e-3),
    Range("learning_gain", 0.3, 1.5),
)
RANGES: Mapping[str, tuple[Range, ...]] = {
    law: tuple(replace(each, high=_WIDER.get(each.key, each.high)) for each in SEARCHES[law].ranges)
    for law in ("pi", "pi-deadband", "knocker", "constant-reinforcement")
} | {"two-move-retry": _RETRIES}
"""What is tuned of each law; the length of the moves of `two-move-retry` follows the lag."""


@dataclass(frozen=True, slots=True)
class Task:
    """One search: the law, the lag and the noise, how many candidates, and the seed of the search and of the noise."""

    law: str
    lag_s: float
    noise: str
    budget: int
    seed: int


@dataclass(frozen=True, slots=True)
class Found:
    """The result of a search: the values of the law's ranges, and their cost."""

    values: tuple[float, ...]
    cost: float


def tune_all(tasks: Sequence[Task], pool: Pool) -> dict[Task, Found]:
    """Return the result of every task; it does not depend on the pool."""
    found = {}
    with tqdm(total=len(tasks), unit=" searches", disable=None) as bar:
        for task, result in pool.results(searched, tasks):
            found[task] = result
            bar.set_postfix_str(f"{task.law}, lag {task.lag_s * 1e3:g} ms: cost {result.cost:.3f}")
            bar.update()
    return {task: found[task] for task in tasks}


def searched(task: Task) -> Found:
    """Return the best candidate of a search."""
    ranges = RANGES[task.law]
    best = math.inf

    def cost(coordinates: Sequence[float]) -> float:
        nonlocal best
        values = _values(ranges, coordinates)
        found = 0.0
        for plant in (NOMINAL, STOCHASTIC):
            found += 0.5 * _cost(task, plant, values, 2.0 * _HOPELESS * best)
        best = min(best, found)
        return found

    limits = [_limits(each) for each in ranges]
    lows, highs = zip(*limits, strict=True)
    result = differential_evolution(
        cost,
        limits,
        x0=[_coordinate(each, value) for each, value in zip(ranges, _packaged(task), strict=True)],
        init=qmc.scale(qmc.LatinHypercube(len(ranges), seed=task.seed).random(_MEMBERS), lows, highs),
        maxiter=max(1, task.budget // _MEMBERS - 1),
        tol=0.0,
        polish=False,
        seed=task.seed,
    )
    return Found(_values(ranges, result.x), float(result.fun))


def to_toml(law: str, budget: int, seed: int, found: Mapping[Task, Found]) -> str:
    """Return the packaged file of a law: an entry for each lag and noise, and the command that found them."""
    entries = [
        {"lag_s": task.lag_s, "noise": task.noise, "cost": round(result.cost, 4), **control_table(task, result.values)}
        for task, result in found.items()
    ]
    how = f"# positioner tune {law} --real-valves --budget {budget} --seed {seed}\n"
    return how + tomli_w.dumps({"tuned": entries})


def control_table(task: Task, values: Sequence[float]) -> dict[str, Any]:
    """Return the `[control]` table of a configuration in which the law of the task has these `values`."""
    name = table_name(task.law)
    table: dict[str, Any] = dict(rival_tables(task.law, task.lag_s, "")).get(name, {})
    for each, value in zip(RANGES[task.law], values, strict=True):
        group, _, key = each.key.rpartition(".")
        if group:
            table[group] = {**table.get(group, {}), key: value}
        else:
            table[key] = value
    return {name: table}


def _cost(task: Task, plant: str, values: Sequence[float], limit: float) -> float:
    bout = RealBout(
        law=task.law,
        plant=plant,
        lag_s=task.lag_s,
        noise=task.noise,
        seed=task.seed,
        condition=AS_CONFIGURED,
        setpoints=SETPOINTS,
        dwell_s=round(DWELL_S + _DWELL_LAGS * task.lag_s, 1),
        period_s=0.001,
    )
    return cost_of(replace(bout.scenario, control=control_table(task, values)), limit)


def _packaged(task: Task) -> list[float]:
    """Return the values of the law's ranges in its packaged parameters for a valve without lag, within the ranges."""
    settings = getattr(ControlSettings(), table_name(task.law))
    found = []
    for each in RANGES[task.law]:
        value = settings
        for key in each.key.split("."):
            value = getattr(value, key)
        found.append(value if each.or_none and value == 0.0 else min(max(value, each.low), each.high))
    return found


def _limits(each: Range) -> tuple[float, float]:
    """Return the limits of the coordinate; below the logarithm of the lower limit it stands for 0."""
    return math.log(each.low) - _ABSENT * each.or_none, math.log(each.high)


def _coordinate(each: Range, value: float) -> float:
    return math.log(value) if value else math.log(each.low) - 0.5 * _ABSENT


def _values(ranges: Sequence[Range], coordinates: Sequence[float]) -> tuple[float, ...]:
    """Return the values of a candidate as they are written; a pulse longer than its period becomes half the period."""
    values = {
        each.key: 0.0 if coordinate < math.log(each.low) else float(f"{math.exp(coordinate):.4g}")
        for each, coordinate in zip(ranges, coordinates, strict=True)
    }
    if "pulse_width_s" in values:
        values["pulse_width_s"] = min(values["pulse_width_s"], float(f"{0.5 * values['pulse_period_s']:.4g}"))
    return tuple(values.values())
