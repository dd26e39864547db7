"""The figures of one case: where the stem can be, the smallest moves, the error that is left, durations. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.reach.expected import corrections, mean_error_m
from positioner.reach.moves import durations, smallest_push_m

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
    averaged_m: σ of the mean of the readings of one second at rest.
    first_m: σ of the place where a first move to a setpoint ends, once friction and lag are known.
    error_m: the mean error that is left.
    shortest_s, law_s: duration of a move by a tenth of the span, to 1 % of span: the shortest, and the law's without a
        correction. share: of the moves that need one; correction_s: what it adds; mean_s: the mean duration with them.
    """

    low_m: float
    high_m: float
    low_reach_m: float
    high_reach_m: float
    natural_jump_m: float
    push_m: float
    averaged_m: float
    first_m: float
    error_m: float
    shortest_s: float
    law_s: float
    share: float
    correction_s: float
    mean_s: float


def figures_of(case: Case) -> Figures:
    """Return the figures of `case`."""
    valve = case.valve
    move, more = durations(case, MOVE_OF_SPAN * valve.span_m), corrections(case)
    low_m, high_m = valve.restartable_m(case.low_ma, case.high_ma)
    low_reach_m, high_reach_m = valve.reach_m(case.low_ma, case.high_ma)
    return Figures(
        low_m=low_m,
        high_m=high_m,
        low_reach_m=low_reach_m,
        high_reach_m=high_reach_m,
        natural_jump_m=case.belief.jump_m,
        push_m=max(smallest_push_m(case, direction) for direction in (1.0, -1.0)),
        averaged_m=case.averaged_m,
        first_m=more.first_m,
        error_m=mean_error_m(case),
        shortest_s=move.shortest_s,
        law_s=move.law_s,
        share=more.share,
        correction_s=more.correction_s,
        mean_s=more.mean_s(move.law_s),
    )
