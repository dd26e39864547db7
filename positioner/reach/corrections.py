"""What corrections add to a move: how many moves are to be expected, and how long they take. Pure.

A landing scatters, with σ of a normal distribution. The first one, far away on a fast ramp, scatters more than the
readings explain (`_OF_JUMP`, `_OF_LANDING`). A correction begins when the average is certain enough. Where it is nearer
than the smallest jump that the readings show, the stem steps aside first: two moves, which are made again where one of
them lands badly (`_IN_A_ROW`). These three numbers are from closed loops (`python -m benchmarks.reach_durations`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.valve import is_lagged
from positioner.reach.expected import natural_jump_m
from positioner.reach.large_moves import SETTLED_OF_SPAN, of_the_law_s

if TYPE_CHECKING:
    from positioner.reach.case import Case
    from positioner.reach.small_moves import Jump

_OF_JUMP, _OF_LANDING = 0.12, 2.7
"""σ of a first landing behind a lag: of the natural jump, and of σ of a landing as the readings allow it."""
_IN_A_ROW = 3.0
"""So many landings in a row must be good until a step aside and a jump have corrected an error."""
_FAR_SIGMA, _ASIDE_SIGMA = 2.5, 0.25
"""As in the law: an error beyond so many σ of the average is corrected; aside, it averages to this part of one."""
_TYPICAL = 1.2
"""An error that is to be corrected, as a part of the limit that it exceeds."""
_SPARE, _WORTH = 1.15, 1.4
"""As in the law: the jump's spare; an error beyond so many tolerances is worth a correction."""
_LEAST = 0.01
_STOPPED = 0.2
"""A small move has ended within this part of its way."""


@dataclass(frozen=True, slots=True)
class Corrections:
    """share: of first landings that are not within 1 % of span; correction_s: of a correction; moves: of a setpoint."""

    share: float
    correction_s: float
    moves: float

    def mean_s(self, first_s: float) -> float:
        """Return the mean duration until the stem is within 1 % of span, if the first move takes `first_s`."""
        return first_s + self.share * self.correction_s


def corrections(case: Case, jump: Jump) -> Corrections:
    """Return what is to be expected; `jump` is the smallest that the readings show."""
    near_m, tolerance_m = SETTLED_OF_SPAN * case.valve.span_m, case.tolerance_m
    first_m, lagged = jump.landing_m, is_lagged(case.valve)
    if lagged:
        first_m = math.hypot(_OF_JUMP * natural_jump_m(case), _OF_LANDING * jump.landing_m)
    is_aside = lagged and _TYPICAL * near_m < _SPARE * jump.jump_m
    certain_m = (_TYPICAL * near_m - tolerance_m) / _FAR_SIGMA
    readings = max((case.sigma_m / certain_m) ** 2, 1.0) if certain_m > 0.0 else math.inf
    way_m = max(_SPARE * jump.jump_m, near_m)
    one_s = of_the_law_s(case, way_m, jump.rate_ma_per_s, _STOPPED * way_m) + case.settings.lagged.settle_s
    share, correction_s = _outside(near_m, first_m), readings * case.period_s + one_s
    if is_aside:
        correction_s += case.period_s / (_ASIDE_SIGMA * _ASIDE_SIGMA) + one_s
        correction_s /= max((1.0 - share) ** _IN_A_ROW, _LEAST)
    return Corrections(share, correction_s, 1.0 + share + _outside(_WORTH * tolerance_m, jump.landing_m))


def _outside(limit_m: float, sigma_m: float) -> float:
    return math.erfc(limit_m / (math.sqrt(2.0) * sigma_m)) if sigma_m > 0.0 else 0.0
