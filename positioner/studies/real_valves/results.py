"""The results of the league on real valves, cell by cell. Pure.

A cell is all dwells of one law on one plant with one lag and one noise, under one condition.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean, median
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from plant_emulator.presets import plant_settings
from positioner.bench.metrics import median_settling_s
from positioner.studies.limit import optimal_move
from positioner.studies.real_valves.conditions import AS_CONFIGURED, CONDITIONS
from positioner.studies.real_valves.valves import NOMINAL, plant_tables, setpoints_mm

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from positioner.bench.metrics import DwellMetrics
    from positioner.studies.real_valves.bouts import RealBout

Choice: TypeAlias = Callable[["Cell"], bool]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """The figures of one cell; errors in percent of span, travel over the shortest way."""

    law: str
    plant: str
    lag_s: float
    noise: str
    condition: str
    dwells: int
    mean_pct: float
    percentile_95_pct: float
    worst_pct: float
    median_settle_1pct_s: float | None
    unsettled: int
    limit_cycles: int
    travel_ratio: float
    errors_pct: tuple[float, ...]
    """The mean error of each dwell."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Results:
    """All cells, and the median of the time-optimal settling in s of the same moves on the nominal valve, by lag."""

    cells: tuple[Cell, ...]
    optimal_settle_s: Mapping[float, float]

    def chosen(self, *choices: Choice, condition: str = AS_CONFIGURED) -> tuple[Cell, ...]:
        """Return the cells of a condition that meet every choice."""
        return tuple(cell for cell in self.cells if cell.condition == condition and all(each(cell) for each in choices))

    @property
    def lags_s(self) -> tuple[float, ...]:
        """The lags of the main part, ascending."""
        return tuple(sorted({cell.lag_s for cell in self.chosen(lambda cell: cell.plant == NOMINAL)}))


def results_of(played: Mapping[RealBout, Sequence[DwellMetrics]], setpoints: int) -> Results:
    """Return the results of the bouts, in the order in which they were played."""
    groups: dict[tuple[str, str, float, str, str], list[DwellMetrics]] = {}
    for bout, dwells in played.items():
        condition = CONDITIONS.get(bout.condition)
        judged = dwells[condition.skipped if condition else 0 :] or dwells[-1:]
        key = (bout.law, bout.plant, bout.lag_s, bout.noise, bout.condition)
        groups.setdefault(key, []).extend(judged)
    cells = tuple(_cell(*key, dwells) for key, dwells in groups.items())
    nominal = {cell.lag_s for cell in cells if cell.plant == NOMINAL and cell.condition == AS_CONFIGURED}
    return Results(
        cells=cells, optimal_settle_s={lag_s: optimal_settle_s(lag_s, setpoints) for lag_s in sorted(nominal)}
    )


def _cell(law: str, plant: str, lag_s: float, noise: str, condition: str, dwells: Sequence[DwellMetrics]) -> Cell:
    errors = tuple(dwell.mean_abs_error_pct for dwell in dwells)
    return Cell(
        law=law,
        plant=plant,
        lag_s=lag_s,
        noise=noise,
        condition=condition,
        dwells=len(dwells),
        mean_pct=fmean(errors),
        percentile_95_pct=percentile_95(errors),
        worst_pct=max(errors),
        median_settle_1pct_s=median_settling_s(dwell.settle_1pct_s for dwell in dwells),
        unsettled=sum(dwell.settle_1pct_s is None for dwell in dwells),
        limit_cycles=sum(dwell.limit_cycle for dwell in dwells),
        travel_ratio=sum(dwell.travel_mm for dwell in dwells) / sum(dwell.ideal_travel_mm for dwell in dwells),
        errors_pct=errors,
    )


def percentile_95(values: Iterable[float]) -> float:
    """Return the value that 95 % of `values` do not exceed."""
    return float(np.percentile(list(values), 95.0))


def optimal_settle_s(lag_s: float, setpoints: int) -> float:
    """Return the median over the moves of the nominal valve of the time-optimal time until the 1 % band, in s."""
    settings = plant_settings(overrides=plant_tables(NOMINAL, lag_s, "0.05", {}))
    places_m = [
        settings.valve.initial_position_m,
        *(place * 1e-3 for place in setpoints_mm(plant_settings(NOMINAL))[:setpoints]),
    ]
    moves = (optimal_move(settings, start_m, end_m) for start_m, end_m in pairwise(places_m))
    return median(move.settle_1pct_s for move in moves)
