"""What the figures of many dwells say: distributions, lost dwells with their bounds, and the best baseline. Pure.

Definitions (docs/robustness.md):

- *reachable*: some law that was played, or the judged law with the true parameters, ends within 0.5 % without hunting.
- *lost*: reachable, and the dwell ends more than 1 % off, or hunts.
- *good while lost*: lost, and the last status said ACTIVE without a cause.
- *worse than a baseline*: the 95 % interval of the mean difference of |error|, paired by valve, lies above zero.
"""

from __future__ import annotations

import bisect
import itertools
import math
from dataclasses import dataclass
from statistics import fmean, stdev
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from plant_emulator.presets import plant_settings
from positioner.robustness.cases import BEYOND

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from positioner.robustness.cases import Case
    from positioner.robustness.play import Dwell, Played

LOST_PCT, REACHED_PCT = 1.0, 0.5
LEAST_IN_BIN = 200
"""Dwells in each bin of a factor, where there are so many."""
STEP = "step_of_span"
NUMBER = "number_of_setpoint"
"""The factors that each dwell has for itself: how far its setpoint is from the one before, and how many were before."""
_MOST_BINS, _MOST_NUMBERS = 5, 10
_CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """One dwell of one case: the figures by law, the time-optimal settling, and whether it is reachable."""

    case: Case
    number: int
    by_law: Mapping[str, Dwell]
    optimal_s: float
    reachable: bool

    def is_lost(self, law: str) -> bool:
        """Whether the law lost this dwell."""
        return self.reachable and went_wrong(self.by_law[law])


@dataclass(frozen=True, slots=True, kw_only=True)
class Rate:
    """How many of so many, with the 95 % limits of the part (Clopper and Pearson, 1934)."""

    count: int
    of: int

    @property
    def limits(self) -> tuple[float, float]:
        """Return the limits of the part, 0 to 1."""
        outside = (1.0 - _CONFIDENCE) / 2.0
        low = stats.beta.ppf(outside, self.count, self.of - self.count + 1) if self.count else 0.0
        high = stats.beta.ppf(1.0 - outside, self.count + 1, self.of - self.count) if self.count < self.of else 1.0
        return float(low), float(high)


@dataclass(frozen=True, slots=True, kw_only=True)
class Distribution:
    """The figures of one law over many dwells; errors and overshoot in percent of span.

    settle_ratio, settle_ratio_95: settling time over the time-optimal one, median and 95 %; inf: never.
    travel_ratio: path over the shortest one, both summed. difference_pct: mean error less that of the best baseline,
    with its 95 % interval; None for a baseline.
    """

    law: str
    dwells: int
    mean_pct: float
    quantiles_pct: tuple[float, float, float, float]
    """Median, 95, 99 and 99.9 %."""
    worst_pct: float
    overshoot_95_pct: float
    settle_ratio: float
    settle_ratio_95: float
    moves: float
    travel_ratio: float
    lost: Rate
    good_while_lost: int
    failed: int
    baseline: str | None = None
    difference_pct: tuple[float, float, float] | None = None

    @property
    def is_worse(self) -> bool:
        """Whether the best baseline is better beyond chance."""
        return self.difference_pct is not None and self.difference_pct[1] > 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Bin:
    """A part of the range of a factor, and what the law and the best baseline do there."""

    factor: str
    low: float
    high: float
    law: Distribution
    best: Distribution | None


def went_wrong(dwell: Dwell) -> bool:
    """Whether a dwell ended more than 1 % off, or hunts."""
    return dwell.error_pct > LOST_PCT or dwell.hunts


def reached(dwell: Dwell) -> bool:
    """Whether a dwell shows that its setpoint can be reached."""
    return dwell.error_pct <= REACHED_PCT and not dwell.hunts


def undecided(case: Case, by_law: Mapping[str, Played]) -> bool:
    """Whether some law lost a dwell that no law reached: then the law with the true parameters says if it can be."""
    played = [each.dwells for each in by_law.values() if each.dwells]
    return case.group != BEYOND and any(
        any(map(went_wrong, dwells)) and not any(map(reached, dwells)) for dwells in zip(*played, strict=True)
    )


def verdicts(
    cases: Sequence[Case], played: Mapping[str, Mapping[str, Played]], informed: Mapping[str, Played]
) -> list[Verdict]:
    """Return every dwell that is judged; a case that some law could not play to its end is left out.

    Args:
        cases: the cases.
        played: by the label of a case and the name of a law, what it did; with the time-optimal moves.
        informed: by the label of a case, what the judged law did with the true parameters, where that was played.
    """
    found = []
    for case in cases:
        own = {law: each for law, each in played[case.label].items() if each.dwells}
        optimal_s = next((each.optimal_s for each in played[case.label].values() if each.optimal_s), ())
        if len(own) + bool(optimal_s) < len(played[case.label]):
            continue
        oracle = informed.get(case.label)
        for number, dwells in enumerate(zip(*(each.dwells for each in own.values()), strict=True)):
            if number < case.skipped:
                continue
            judges = (*dwells, oracle.dwells[number]) if oracle and oracle.dwells else dwells
            found.append(
                Verdict(
                    case=case,
                    number=number,
                    by_law=dict(zip(own, dwells, strict=True)),
                    optimal_s=optimal_s[number] if optimal_s else math.nan,
                    reachable=any(map(reached, judges)),
                )
            )
    return found


def distribution(law: str, judged: Sequence[Verdict], baselines: Iterable[str] = (), failed: int = 0) -> Distribution:
    """Return the figures of `law`; beside those of the best of the `baselines`, by its mean error.

    Raises:
        ValueError: there are no dwells.
    """
    if not judged:
        raise ValueError("no dwells")
    dwells = [each.by_law[law] for each in judged]
    errors = _errors(law, judged)
    settles = [
        math.inf if one.settle_s is None else one.settle_s / each.optimal_s
        for one, each in zip(dwells, judged, strict=True)
        if each.optimal_s > 0.0
    ]
    lost = [each for each in judged if each.is_lost(law)]
    travel_mm, ideal_mm = sum(one.travel_mm for one in dwells), sum(one.ideal_mm for one in dwells)

    def at(part: float) -> float:
        return float(np.quantile(errors, part))

    best = min(baselines, key=lambda other: float(_errors(other, judged).mean()), default=None)
    return Distribution(
        law=law,
        dwells=len(dwells),
        mean_pct=float(errors.mean()),
        quantiles_pct=(at(0.5), at(0.95), at(0.99), at(0.999)),
        worst_pct=float(errors.max()),
        overshoot_95_pct=float(np.quantile([one.overshoot_pct for one in dwells], 0.95)),
        settle_ratio=_quantile(settles, 0.5),
        settle_ratio_95=_quantile(settles, 0.95),
        moves=fmean(one.moves for one in dwells),
        travel_ratio=travel_mm / ideal_mm if ideal_mm else math.nan,
        lost=Rate(count=len(lost), of=len(dwells)),
        good_while_lost=sum(each.by_law[law].good for each in lost),
        failed=failed,
        baseline=best,
        difference_pct=None if best is None else _difference(law, best, judged),
    )


def bins(law: str, baselines: Sequence[str], judged: Sequence[Verdict]) -> list[Bin]:
    """Return what each factor does: bins of about equal numbers of dwells; those of equal values stay together.

    Step and number of the setpoint are factors of the dwell, and the first ones; the others are those of its valve.
    """
    names = dict.fromkeys(name for each in judged for name in each.case.factors)
    cases = {each.case.label: each.case for each in judged}
    span_mm = {label: 1e3 * plant_settings(overrides=case.true).valve.span_m for label, case in cases.items()}
    steps = [(abs(each.by_law[law].step_mm) / span_mm[each.case.label], each) for each in judged]
    numbers = [(float(each.number + 1), each) for each in judged]
    found = [*_bins_of(STEP, steps, law, baselines), *_bins_of(NUMBER, numbers, law, baselines, _MOST_NUMBERS)]
    for name in names:
        having = [(each.case.factors[name], each) for each in judged if name in each.case.factors]
        found += _bins_of(name, having, law, baselines)
    return found


def _bins_of(
    name: str, having: Sequence[tuple[float, Verdict]], law: str, baselines: Sequence[str], most: int = _MOST_BINS
) -> list[Bin]:
    """Return the bins of one factor, from its values: as many as have enough dwells each, at most `most`."""
    having = sorted(having, key=lambda one: one[0])
    values = [value for value, _ in having]
    count = min(max(len(having) // LEAST_IN_BIN, 1), most)
    wanted = [round(len(having) * step / count) for step in range(1, count)]
    # where the wanted edge divides equal values, all of them are in the lower bin
    edges = [0, *dict.fromkeys(bisect.bisect_right(values, values[each - 1]) for each in wanted), len(having)]
    found = []
    for first, last in itertools.pairwise(dict.fromkeys(edges)):
        part = [each for _, each in having[first:last]]
        own = distribution(law, part, baselines)
        best = distribution(own.baseline, part) if own.baseline else None
        found.append(Bin(factor=name, low=values[first], high=values[last - 1], law=own, best=best))
    return found


def worst(law: str, judged: Sequence[Verdict], count: int) -> list[Verdict]:
    """Return the worst lost dwells of `law`, at most one of each case, the worst first."""
    lost = sorted((each for each in judged if each.is_lost(law)), key=lambda one: -one.by_law[law].error_pct)
    by_case: dict[str, Verdict] = {}
    for each in lost:
        by_case.setdefault(each.case.label, each)
    return list(by_case.values())[:count]


def _errors(law: str, judged: Sequence[Verdict]) -> NDArray[np.float64]:
    return np.array([each.by_law[law].error_pct for each in judged])


def _difference(law: str, other: str, judged: Sequence[Verdict]) -> tuple[float, float, float]:
    """Return the mean difference of the errors with its 95 % interval (Student), valves being what is independent."""
    by_case: dict[str, list[float]] = {}
    for each in judged:
        gap = each.by_law[law].error_pct - each.by_law[other].error_pct
        by_case.setdefault(each.case.label, []).append(gap)
    means = [fmean(gaps) for gaps in by_case.values()]
    middle = fmean(means)
    if len(means) < 2:  # noqa: PLR2004 - one valve has no interval
        return middle, -math.inf, math.inf
    half = float(stats.t.ppf(0.5 + _CONFIDENCE / 2.0, len(means) - 1)) * stdev(means) / math.sqrt(len(means))
    return middle, middle - half, middle + half


def _quantile(values: Sequence[float], part: float) -> float:
    """Return a quantile of values that may be infinite: one of them."""
    if not values:
        return math.nan
    return sorted(values)[min(int(part * len(values)), len(values) - 1)]
