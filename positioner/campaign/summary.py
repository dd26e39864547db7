"""The summary of a campaign: laws, the effect of each parameter, and the worst corners. Pure.

Intervals are those of the league. What is independent depends on the design: the points of a Latin hypercube or a Sobol
sequence are a sample of the ranges, so an interval is over the means of the points. It is a little too wide, because
these points are more even than chance. The points of a grid are chosen, so an interval is over the means of the seeds.
"""

from __future__ import annotations

import math
from bisect import bisect
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean
from typing import TYPE_CHECKING, TypeAlias

from positioner.bench.metrics import median_settling_s
from positioner.bench.modes import ACTIVE_AT_LEAST
from positioner.campaign.schema import Kind
from positioner.studies.standings import bootstrap_interval

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from positioner.campaign.design import Parameter
    from positioner.campaign.plan import Campaign
    from positioner.campaign.run import Figures, PlayedRun

    Runs: TypeAlias = Sequence[tuple[PlayedRun, Figures]]

_MOST_PARTS = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Mean:
    """A mean error in percent of span, with its 95 % interval; the limits are None where nothing varies by chance."""

    mean_pct: float
    low_pct: float | None
    high_pct: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LawSummary:
    """One law over all points and seeds; `positioner.bench.metrics` defines the figures.

    out_of_control: runs in which the law was in control for less than 99 % of the time. failed: without figures.
    """

    law: str
    runs: int
    failed: int
    out_of_control: int
    error: Mean
    worst_dwell_pct: float
    median_settle_1pct_s: float | None
    unsettled: int
    limit_cycles: int
    travel_ratio: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A part of a range, from place `begin` to `end` of it (0 to 1), with the mean error of the runs there."""

    begin: float
    end: float
    runs: int
    error: Mean


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """The effect of one parameter on the mean error of one law.

    explained: the part of the variance between the points that this parameter explains alone (Kelley's ε², 1935: the
        correlation ratio without its bias); None where the points do not suffice, or do not differ.
    """

    law: str
    parameter: str
    parts: tuple[Part, ...]
    explained: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """All that the report shows; the corners are the worst runs, the worst first, one for each law and point."""

    laws: tuple[LawSummary, ...]
    effects: tuple[Effect, ...]
    corners: tuple[PlayedRun, ...]


def summary_of(campaign: Campaign, played: Sequence[PlayedRun]) -> Summary:
    """Return the summary of a campaign that was played."""
    by_law = {law: [each for each in played if each.run.law == law] for law in campaign.laws}
    found = {
        law: [(each, each.outcome.figures) for each in runs if each.outcome.figures] for law, runs in by_law.items()
    }
    return Summary(
        laws=tuple(_law(campaign, law, runs, found[law]) for law, runs in by_law.items() if found[law]),
        effects=tuple(
            _effect(campaign, law, place, runs)
            for law, runs in found.items()
            if runs
            for place in range(len(campaign.parameters))
        ),
        corners=tuple(corner for runs in by_law.values() for corner in _worst(runs, campaign.file.worst)),
    )


def _law(campaign: Campaign, law: str, all_runs: Sequence[PlayedRun], runs: Runs) -> LawSummary:
    figures = [each for _, each in runs]
    ideal_mm = sum(each.ideal_travel_mm for each in figures)
    return LawSummary(
        law=law,
        runs=len(all_runs),
        failed=len(all_runs) - len(runs),
        out_of_control=sum(each.active_fraction < ACTIVE_AT_LEAST for each in figures),
        error=_mean(campaign, runs),
        worst_dwell_pct=max(each.worst_mean_abs_error_pct for each in figures),
        median_settle_1pct_s=median_settling_s(each.median_settle_1pct_s for each in figures),
        unsettled=sum(each.unsettled_1pct for each in figures),
        limit_cycles=sum(each.limit_cycles for each in figures),
        travel_ratio=sum(each.travel_mm for each in figures) / ideal_mm if ideal_mm > 0.0 else None,
    )


def _mean(campaign: Campaign, runs: Runs) -> Mean:
    """Return the mean error of `runs`, with the interval that suits the design."""
    if campaign.file.design.kind is Kind.GRID:
        independent = _means(runs, lambda each: each.run.seed)
    else:
        independent = _means(runs, lambda each: each.run.point)
    low, high = bootstrap_interval(independent)
    return Mean(mean_pct=fmean(each.mean_abs_error_pct for _, each in runs), low_pct=low, high_pct=high)


def _means(runs: Runs, group: Callable[[PlayedRun], int]) -> list[float]:
    """Return the mean error of each group of `runs`."""
    groups: dict[int, list[float]] = {}
    for each, figures in runs:
        groups.setdefault(group(each), []).append(figures.mean_abs_error_pct)
    return [fmean(errors) for errors in groups.values()]


def _effect(campaign: Campaign, law: str, place: int, runs: Runs) -> Effect:
    parameter = campaign.parameters[place]
    edges = _edges(campaign, parameter)
    last = len(edges) - 2
    parts: dict[int, list[tuple[PlayedRun, Figures]]] = {}
    for each, figures in runs:
        where = parameter.place_of(each.run.values[place])
        part = min(max(bisect(edges, where) - 1, 0), last)
        parts.setdefault(part, []).append((each, figures))
    return Effect(
        law=law,
        parameter=parameter.name,
        parts=tuple(
            Part(begin=edges[part], end=edges[part + 1], runs=len(inside), error=_mean(campaign, inside))
            for part, inside in sorted(parts.items())
        ),
        explained=explained([_means(inside, lambda each: each.run.point) for inside in parts.values()]),
    )


def _edges(campaign: Campaign, parameter: Parameter) -> list[float]:
    """Return the edges of the parts of a range, from 0 to 1: one part for each level, or equal ones."""
    if parameter.range.values is not None:
        count = len(parameter.range.values)
    elif campaign.file.design.kind is Kind.GRID:
        places = [parameter.place_of(level) for level in parameter.levels]
        return [0.0, *((one + next_) / 2.0 for one, next_ in pairwise(places)), 1.0]
    else:
        count = min(_MOST_PARTS, max(2, math.isqrt(campaign.file.design.points or 0)))
    return [part / count for part in range(count + 1)]


def by_chance(campaign: Campaign) -> float | None:
    """Return what a parameter without any effect may explain by chance, from 0 to 1; None for a grid.

    Two standard deviations of ε² of n points in k parts: η² of values without an effect has the beta distribution of
    ((k - 1)/2, (n - k)/2), and ε² = 1 - (1 - η²)(n - 1)/(n - k). 1 where every part has a single point.
    """
    if campaign.file.design.kind is Kind.GRID:
        return None
    points = campaign.file.design.points or 0
    parts = max((len(_edges(campaign, each)) - 1 for each in campaign.parameters), default=1)
    if points <= parts:
        return 1.0
    spread = math.sqrt(2.0 * (parts - 1) * (points - parts) / ((points - 1) ** 2 * (points + 1)))
    return min(2.0 * spread * (points - 1) / (points - parts), 1.0)


def explained(groups: Sequence[Sequence[float]]) -> float | None:
    """Return ε² of values in `groups`, from 0 to 1; None where they do not suffice or are all equal."""
    values = [value for group in groups for value in group]
    freedom = len(values) - len(groups)
    whole = sum((value - fmean(values)) ** 2 for value in values) if values else 0.0
    if freedom < 1 or whole == 0.0:
        return None
    inside = sum((value - fmean(group)) ** 2 for group in groups for value in group)
    return max(0.0, 1.0 - (inside / freedom) / (whole / (len(values) - 1)))


def _worst(runs: Iterable[PlayedRun], count: int) -> list[PlayedRun]:
    """Return the `count` worst runs, the worst first; of each point only the worst seed."""
    ordered = sorted(runs, key=_badness, reverse=True)
    first: dict[int, PlayedRun] = {}
    for each in ordered:
        first.setdefault(each.run.point, each)
    return list(first.values())[:count]


def _badness(played: PlayedRun) -> tuple[bool, bool, float]:
    figures = played.outcome.figures
    if figures is None:
        return True, True, 0.0
    return False, figures.active_fraction < ACTIVE_AT_LEAST, figures.worst_mean_abs_error_pct
