"""The league's standings: figures of each law on each plant, with their uncertainty. Shell: a plant may be a file.

The dwells of one run correlate, because the law learns from each of them; only the seeds are independent. The interval
is a 95 % percentile bootstrap over the seeds' means (Efron and Tibshirani, 1993); a single seed has none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import fmean, median
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import bootstrap

from plant_emulator.plants import plant_named
from positioner.bench.metrics import median_settling_s
from positioner.studies.conditions import reference_plant
from positioner.studies.limit import optimal_move

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from positioner.bench.metrics import DwellMetrics
    from positioner.studies.league import Bout

_RESAMPLES = 9999


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """One law on one plant, over all seeds and dwells; errors in percent of span.

    `positioner.bench.metrics` defines the figures. The limits of the mean error are None for a single seed.
    """

    law: str
    plant: str
    dwells: int
    mean_error_pct: float
    mean_error_low_pct: float | None
    mean_error_high_pct: float | None
    worst_dwell_pct: float
    median_settle_1pct_s: float | None
    unsettled: int
    limit_cycles: int
    travel_ratio: float
    settle_quartiles_s: tuple[float | None, float | None] = (None, None)


@dataclass(frozen=True, slots=True, kw_only=True)
class LawSummary:
    """One law over all plants; `error_ratio` is the mean error on its worst plant, divided by that of `nmpc`.

    Settling and `reference_error_pct` are those of the reference plant. settle_quartiles_s: half of the dwells settle
    between them; None where a quarter or more of the dwells never settle.
    """

    law: str
    reference_error_pct: float
    worst_plant: str
    worst_plant_error_pct: float
    worst_dwell_pct: float
    unsettled: int
    limit_cycles: int
    median_settle_1pct_s: float | None
    settle_ratio: float | None
    travel_ratio: float
    error_ratio: float | None
    settle_quartiles_s: tuple[float | None, float | None] = (None, None)


def standings(played: Mapping[Bout, Sequence[DwellMetrics]]) -> tuple[Standing, ...]:
    """Return one standing for each law and plant, in the order in which they were played."""
    cells: dict[tuple[str, str], list[Sequence[DwellMetrics]]] = {}
    for bout, dwells in played.items():
        cells.setdefault((bout.law, bout.plant), []).append(dwells)
    return tuple(_standing(law, plant, runs) for (law, plant), runs in cells.items())


def _standing(law: str, plant: str, runs: Sequence[Sequence[DwellMetrics]]) -> Standing:
    """Return the standing after `runs`, one for each seed."""
    dwells = [dwell for run in runs for dwell in run]
    errors = [dwell.mean_abs_error_pct for dwell in dwells]
    low, high = bootstrap_interval([fmean(dwell.mean_abs_error_pct for dwell in run) for run in runs])
    return Standing(
        law=law,
        plant=plant,
        dwells=len(dwells),
        mean_error_pct=fmean(errors),
        mean_error_low_pct=low,
        mean_error_high_pct=high,
        worst_dwell_pct=max(errors),
        median_settle_1pct_s=median_settling_s(dwell.settle_1pct_s for dwell in dwells),
        unsettled=sum(dwell.settle_1pct_s is None for dwell in dwells),
        limit_cycles=sum(dwell.limit_cycle for dwell in dwells),
        travel_ratio=sum(dwell.travel_mm for dwell in dwells) / sum(dwell.ideal_travel_mm for dwell in dwells),
        settle_quartiles_s=_quartiles_s([dwell.settle_1pct_s for dwell in dwells]),
    )


def _quartiles_s(settled_s: Sequence[float | None]) -> tuple[float | None, float | None]:
    """Return the quartiles of settling times; a dwell that never settles is later than all others."""
    ascending = np.sort([math.inf if each is None else each for each in settled_s])
    low, high = np.quantile(ascending, (0.25, 0.75), method="higher")
    return float(low) if math.isfinite(low) else None, float(high) if math.isfinite(high) else None


def bootstrap_interval(values: Sequence[float]) -> tuple[float, float] | tuple[None, None]:
    """Return the 95 % percentile bootstrap interval of the mean of independent `values`; None for fewer than two."""
    if len(values) < 2:  # noqa: PLR2004 - one value has no spread
        return None, None
    found = bootstrap((values,), np.mean, n_resamples=_RESAMPLES, method="percentile", random_state=0)
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def summaries(
    table: Sequence[Standing], optimal_settle_1pct_s: float | None, reference: str = "nmpc"
) -> tuple[LawSummary, ...]:
    """Return one summary for each law, the best first; `optimal_settle_1pct_s` is the time-optimal median."""
    laws = dict.fromkeys(standing.law for standing in table)
    worst = {law: max((s for s in table if s.law == law), key=lambda s: s.mean_error_pct) for law in laws}
    ours = worst[reference].mean_error_pct if reference in worst else None
    found = []
    for law in laws:
        rows = [standing for standing in table if standing.law == law]
        here = next(row for row in rows if row.plant == reference_plant([each.plant for each in rows]))
        settle_s = here.median_settle_1pct_s
        found.append(
            LawSummary(
                law=law,
                reference_error_pct=here.mean_error_pct,
                worst_plant=worst[law].plant,
                worst_plant_error_pct=worst[law].mean_error_pct,
                worst_dwell_pct=max(row.worst_dwell_pct for row in rows),
                unsettled=sum(row.unsettled for row in rows),
                limit_cycles=sum(row.limit_cycles for row in rows),
                median_settle_1pct_s=settle_s,
                settle_ratio=settle_s / optimal_settle_1pct_s if settle_s and optimal_settle_1pct_s else None,
                travel_ratio=fmean(row.travel_ratio for row in rows),
                error_ratio=worst[law].mean_error_pct / ours if ours else None,
                settle_quartiles_s=here.settle_quartiles_s,
            )
        )
    return tuple(sorted(found, key=lambda summary: summary.worst_plant_error_pct))


def optimal_median_s(plant: str, setpoints_mm: Sequence[float]) -> tuple[float, float]:
    """Return the medians of the time-optimal moves on `plant` in s: until the 1 % band, and until rest."""
    settings = plant_named(plant)
    starts = (settings.valve.initial_position_m * 1e3, *setpoints_mm[:-1])
    pairs = zip(starts, setpoints_mm, strict=True)
    moves = [optimal_move(settings, start * 1e-3, end * 1e-3) for start, end in pairs if start != end]
    return median(move.settle_1pct_s for move in moves), median(move.rest_s for move in moves)
