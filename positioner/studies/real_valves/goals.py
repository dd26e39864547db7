"""The goals of the law `nmpc` on real valves, and what it reached. Pure.

A figure is of the worst lag, or of all dwells together where the goal says so. It is None where nothing was played that
it needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.studies.entrants import OURS, WITHOUT_TABLE
from positioner.studies.real_valves.conditions import CONDITIONS
from positioner.studies.real_valves.results import percentile_95
from positioner.studies.real_valves.valves import GRAPHITE, NOISES, NOMINAL, STOCHASTIC

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from positioner.studies.real_valves.results import Cell, Choice, Results

LOW, HIGH = tuple(NOISES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """One goal: the limit of a figure, the figure or None, and whether more is better."""

    goal: str
    noise: str
    limit: float
    unit: str
    figure: float | None
    at_least: bool = False

    @property
    def is_met(self) -> bool | None:
        """Whether the goal is reached; None where nobody knows."""
        if self.figure is None:
            return None
        return self.figure >= self.limit if self.at_least else self.figure <= self.limit


def judged(results: Results) -> tuple[Judgement, ...]:
    """Return every goal with its figure."""
    return (*_main_goals(results), *_condition_goals(results))


def _main_goals(results: Results) -> Iterator[Judgement]:
    for noise in (LOW, HIGH):
        is_low = noise == LOW
        ours = [cell for cell in results.chosen(_of(OURS), _with(noise)) if cell.plant != GRAPHITE]
        nominal = [cell for cell in ours if cell.plant == NOMINAL]
        stochastic = [cell for cell in ours if cell.plant == STOCHASTIC]

        def goal(text: str, limit: float, unit: str, figure: float | None, noise: str = noise) -> Judgement:
            return Judgement(goal=text, noise=noise, limit=limit, unit=unit, figure=figure)

        yield goal("nominal mean, every lag", 0.05 if is_low else 0.18, "%", _worst(nominal, _mean))
        yield goal("95 % of dwells, nominal", 0.10 if is_low else 0.45, "%", _percentile(nominal))
        yield goal("95 % of dwells, stochastic", 0.15 if is_low else 0.45, "%", _percentile(stochastic))
        short = [cell for cell in ours if cell.lag_s <= 0.1]  # noqa: PLR2004 - the goal's
        yield goal("worst dwell, lag ≤ 100 ms", 0.3 if is_low else 1.0, "%", _worst(short, lambda cell: cell.worst_pct))
        if is_low:
            slow = [cell for cell in nominal if cell.lag_s >= 0.005]  # noqa: PLR2004 - the goal's
            over = _worst(slow, lambda cell: _settle(cell) / results.optimal_settle_s[cell.lag_s])
            yield goal("settling, nominal, lag ≥ 5 ms, over the time-optimal", 1.5, "×", over)
        else:
            quick = [cell for cell in nominal if cell.lag_s <= 0.1]  # noqa: PLR2004 - the goal's
            slow = [cell for cell in nominal if cell.lag_s > 0.1]  # noqa: PLR2004 - the goal's
            yield goal("settling, nominal, lag ≤ 100 ms", 0.25, "s", _worst(quick, _settle))
            yield goal("settling, nominal, lag 300 ms", 0.9, "s", _worst(slow, _settle))
        yield goal("travel over ideal, nominal", 1.7 if is_low else 2.5, "×", _worst(nominal, lambda c: c.travel_ratio))
        dwells, cycles = sum(cell.dwells for cell in ours), sum(cell.limit_cycles for cell in ours)
        yield goal(f"limit cycles, of {dwells} dwells", 1.0 if is_low else 4.0, "", cycles if ours else None)
        yield _rivals(results, noise, STOCHASTIC, "mean, stochastic, lag ≥ 10 ms", 0.01, 5.0 if is_low else 2.0, _mean)
        if is_low:
            yield _rivals(results, noise, NOMINAL, "settling, nominal, lag ≥ 5 ms", 0.005, 2.0, _settle)
        at_once = [cell for cell in nominal if cell.lag_s == 0.0]
        yield goal("nominal mean without lag", 0.02 if is_low else 0.04, "%", _worst(at_once, _mean))


def _rivals(
    results: Results, noise: str, plant: str, text: str, from_s: float, limit: float, figure: Callable[[Cell], float]
) -> Judgement:
    """Return the goal that the best rival's figure is `limit` times ours, at every lag from `from_s`."""
    ratios = []
    for lag_s in results.lags_s:
        here = [cell for cell in results.chosen(_with(noise)) if (cell.plant, cell.lag_s) == (plant, lag_s)]
        rivals = [figure(cell) for cell in here if cell.law not in {OURS, WITHOUT_TABLE}]
        ours = [figure(cell) for cell in here if cell.law == OURS]
        if lag_s >= from_s and rivals and ours:
            ratios.append(min(rivals) / ours[0])
    return Judgement(
        goal=f"best rival over ours: {text}",
        noise=noise,
        limit=limit,
        unit="×",
        figure=min(ratios, default=None),
        at_least=True,
    )


def _condition_goals(results: Results) -> Iterator[Judgement]:
    groups: dict[tuple[str, str, float], list[Cell]] = {}
    for name, condition in CONDITIONS.items():
        for noise, limit_pct in condition.goal_pct.items():
            cells = groups.setdefault((condition.goal or condition.text, noise, limit_pct), [])
            cells += results.chosen(_of(OURS), _with(noise), condition=name)
    for (goal, noise, limit_pct), cells in groups.items():
        yield Judgement(goal=goal, noise=noise, limit=limit_pct, unit="%", figure=_worst(cells, _mean))


def _of(law: str) -> Choice:
    return lambda cell: cell.law == law


def _with(noise: str) -> Choice:
    return lambda cell: cell.noise == noise


def _mean(cell: Cell) -> float:
    return cell.mean_pct


def _settle(cell: Cell) -> float:
    return float("inf") if cell.median_settle_1pct_s is None else cell.median_settle_1pct_s


def _worst(cells: Iterable[Cell], figure: Callable[[Cell], float]) -> float | None:
    return max((figure(cell) for cell in cells), default=None)


def _percentile(cells: Iterable[Cell]) -> float | None:
    errors = [error for cell in cells for error in cell.errors_pct]
    return percentile_95(errors) if errors else None
