"""The figures of one case: where the stem can be, the smallest moves, the error that is left, durations. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.reach.corrections import corrections
from positioner.reach.expected import averaging_of, mean_error_m, natural_jump_m
from positioner.reach.large_moves import durations
from positioner.reach.small_moves import smallest_jump, smallest_push_m

if TYPE_CHECKING:
    from positioner.reach.case import Case

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
    shortest_s, law_s: duration of a move by a tenth of the span, to 1 % of span: the shortest, and the law's without a
        correction. share: of the moves that need one; correction_s: what it adds; mean_s: the mean duration with them.
    moves: until no error is left that is worth a correction.
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
    share: float
    correction_s: float
    mean_s: float
    moves: float

    @property
    def resolution_m(self) -> float:
        """1 σ of averaging and landing together, in m."""
        return math.hypot(self.averaging_m, self.landing_m)


def figures_of(case: Case) -> Figures:
    """Return the figures of `case`."""
    valve = case.valve
    jumps = [smallest_jump(case, direction) for direction in (1.0, -1.0)]
    worst = max(jumps, key=lambda each: each.jump_m)
    landing_m = max(each.landing_m for each in jumps)
    push_m = max(smallest_push_m(case, direction) for direction in (1.0, -1.0))
    averaging_m, samples = averaging_of(case)
    move = durations(case, MOVE_OF_SPAN * valve.span_m, worst.rate_ma_per_s)
    more = corrections(case, worst)
    low_m, high_m = valve.restartable_m(case.low_ma, case.high_ma)
    low_reach_m, high_reach_m = valve.reach_m(case.low_ma, case.high_ma)
    return Figures(
        low_m=low_m,
        high_m=high_m,
        low_reach_m=low_reach_m,
        high_reach_m=high_reach_m,
        natural_jump_m=natural_jump_m(case),
        push_m=push_m,
        jump_m=worst.jump_m,
        noticed_s=worst.noticed_s,
        averaging_m=averaging_m,
        averaging_s=samples * case.period_s,
        landing_m=landing_m,
        error_m=mean_error_m(case, worst),
        shortest_s=move.shortest_s,
        law_s=move.law_s,
        share=more.share,
        correction_s=more.correction_s,
        mean_s=more.mean_s(move.law_s),
        moves=more.moves,
    )
