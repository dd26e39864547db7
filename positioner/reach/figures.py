"""The figures of one case: where the stem can be, the smallest moves, the error that is left, durations. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.valve import is_lagged
from positioner.reach.large_moves import durations
from positioner.reach.small_moves import smallest_jump, smallest_push_m

if TYPE_CHECKING:
    from positioner.reach.case import Case

_OF_PUSH = 0.1
"""Of a valve without lag: the part of its smallest push that stays as an error, as benches show it."""
MOVE_OF_SPAN = 0.1
"""The move whose duration is given."""


@dataclass(frozen=True, slots=True)
class Figures:
    """Of two directions each figure is that of the worse one.

    low_m, high_m: the places that the stem can leave both ways; low_reach_m, high_reach_m: that it can slide to.
    natural_jump_m: (F_s - F_c)/K.
    push_m: the smallest push of one period.
    jump_m, noticed_s: the smallest jump that the readings show in time, and how long that takes.
    averaging_m, averaging_s: σ of the average of which the law decides, and the time that it takes.
    landing_m: σ of the place where a jump ends.
    error_m: the mean error that is left.
    shortest_s, law_s: duration of a move by a tenth of the span, to 1 % of span: the shortest, and the law's.
    """

    low_m: float
    high_m: float
    low_reach_m: float
    high_reach_m: float
    natural_jump_m: float
    push_m: float
    jump_m: float
    noticed_s: float
    averaging_m: float
    averaging_s: float
    landing_m: float
    error_m: float
    shortest_s: float
    law_s: float

    @property
    def resolution_m(self) -> float:
        """1 σ of averaging and landing together, in m."""
        return math.hypot(self.averaging_m, self.landing_m)


def figures_of(case: Case) -> Figures:
    """Return the figures of `case`."""
    valve, tolerance_m = case.valve, case.tolerance_m
    jumps = [smallest_jump(case, direction) for direction in (1.0, -1.0)]
    worst = max(jumps, key=lambda each: each.jump_m)
    landing_m = max(each.landing_m for each in jumps)
    push_m = max(smallest_push_m(case, direction) for direction in (1.0, -1.0))
    wanted_m = case.settings.lagged.certain_part * tolerance_m
    samples = max(math.ceil(_square(case.sigma_m / wanted_m)), 1)
    averaging_m = case.sigma_m / math.sqrt(samples)
    move = durations(case, MOVE_OF_SPAN * valve.span_m, worst.rate_ma_per_s)
    low_m, high_m = valve.restartable_m(case.low_ma, case.high_ma)
    low_reach_m, high_reach_m = valve.reach_m(case.low_ma, case.high_ma)
    return Figures(
        low_m=low_m,
        high_m=high_m,
        low_reach_m=low_reach_m,
        high_reach_m=high_reach_m,
        natural_jump_m=(valve.static_friction_n - valve.coulomb_friction_n) / valve.spring_rate_n_per_m,
        push_m=push_m,
        jump_m=worst.jump_m,
        noticed_s=worst.noticed_s,
        averaging_m=averaging_m,
        averaging_s=samples * case.period_s,
        landing_m=landing_m,
        error_m=_expected_error_m(math.hypot(averaging_m, landing_m), tolerance_m)
        if is_lagged(valve)
        else math.hypot(tolerance_m / 2.0, _OF_PUSH * push_m),
        shortest_s=move.shortest_s,
        law_s=max(move.law_s, move.shortest_s),
    )


def _expected_error_m(sigma_m: float, tolerance_m: float) -> float:
    """Return the mean |error| of landings with standard deviation σ that are repeated until one is within a tolerance.

    E|e| of a normal distribution that is cut off at ±tolerance: σ √(2/π) (1 - e^(-t²/2σ²))/erf(t/√2σ).
    """
    if sigma_m <= 0.0:
        return 0.0
    ratio = tolerance_m / sigma_m
    return sigma_m * math.sqrt(2.0 / math.pi) * -math.expm1(-ratio * ratio / 2.0) / math.erf(ratio / math.sqrt(2.0))


def _square(value: float) -> float:
    return value * value
