"""Whether the error of a resting stem is worth a move. Pure.

It is corrected once it is probably beyond the tolerance. Where it is nearer than the smallest push carries the stem,
two moves are needed, back and then to the setpoint. At a long period no reading steers them, and each ends somewhere in
the scatter of the landings. So there such an error is corrected only if it is larger than a part of that scatter, and
where the stem has rested for some time, if it is clearly larger: a correction that only draws another place out of the
same scatter, again and again, is a hunt.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from positioner.laws.nmpc.filter import Resting
    from positioner.laws.nmpc.memory import NmpcMemory
    from positioner.laws.nmpc.settings import NmpcSettings

_OF_SCATTER = 0.5
"""Of the standard deviation of landings: a smaller error is not worth two moves."""
_RESTED_S, _RESTED = 1.0, 2.0
"""After a rest of so long the error must be so many times as large: averages improve with time, landings do not."""
_BLIND = 0.5
"""A smallest push longer than this part of the natural jump (F_s - F_c)/K ends before a reading steers it: only there
does a landing scatter more than readings do."""
_NEAR = 0.5
"""Two possible places of the stem are near each other within this part of the error."""


def is_worth_a_move(own: NmpcSettings, memory: NmpcMemory, here: Resting, period_s: float) -> bool:
    """Return whether the error is probably beyond the tolerance, and a move will probably make it smaller.

    A new setpoint is worth a move sooner than a correction. While it is open whether the move before has happened, a
    correction must be right in both cases.
    """
    setpoint_m, tried = memory.setpoint_m, memory.monitor.verification
    assert setpoint_m is not None  # noqa: S101 - the law has one before it considers a move
    error_m = setpoint_m - here.x
    patience = 1.0 + own.patience * min(memory.corrections, own.patience_limit)
    doubt_sigma = own.doubt_sigma if memory.corrections else own.doubt_sigma_unasked
    if memory.is_new:
        doubt_sigma = own.doubt_sigma_first
    if abs(error_m) <= patience * (own.tolerance_m + doubt_sigma * here.sigma_m):
        return False
    jump_m = (memory.monitor.ratio - 1.0) * here.load.friction_n / here.spring_n_per_m
    is_blind = memory.shortest_m > _BLIND * jump_m
    if memory.corrections and is_blind and abs(error_m) < memory.shortest_m:
        has_rested = memory.monitor.noise.rests.count * period_s > _RESTED_S
        share = patience * (_RESTED if has_rested else 1.0) * _OF_SCATTER
        if abs(error_m) <= share * math.sqrt(memory.monitor.repeatability.scatter_m2):
            return False
    if tried is None or not memory.corrections:
        return True
    origin, s = tried.origin, math.copysign(1.0, error_m)
    # two places far apart are soon told apart
    is_near = abs(here.x - origin.x) < _NEAR * abs(error_m)
    return is_near and s * (setpoint_m - origin.x) > patience * (own.tolerance_m + doubt_sigma * origin.sigma_m)
