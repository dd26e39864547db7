"""How often a push may fail to free the stem before the law rests, and for how long. Pure.

A push that fails raises the static friction that `nmpc` believes in, so that a few of them free any stem that can be
freed; `paper` pushes on with its plan. A stem that twenty do not free is jammed, or the law is wrong about it: more of
them only wear the actuator. The law then rests for a second, tries once, rests for twice as long, and so on up to a
minute, until the stem is known to have moved. A setpoint that is elsewhere is pursued at once; one that only trembles,
or creeps, is the same one still.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

MOST_FAILED = 20
"""Pushes that may fail in a row without a rest: 1.03 to the power of it is 1.8."""
_FIRST_REST_S = 1.0
_LONGEST_REST_S = 60.0
_ELSEWHERE_OF_SPAN = 0.01
_BEYOND_DOUBT = 5.0
_INSTANT_S = 1e-9


@dataclass(frozen=True, slots=True)
class Pushes:
    """What is remembered of them.

    failed: those that failed since the stem last moved or the setpoint went elsewhere. anchor_m: the setpoint at that
    time. rests_until_s: in the law's time. rest_s: the length of the rest that the last failure began, 0 for none.
    untold: whether the last failure has yet to be told. stuck_m, sigma_m: where the stem was at the first of them.
    """

    failed: int = 0
    anchor_m: float | None = None
    rests_until_s: float = 0.0
    rest_s: float = 0.0
    untold: bool = False
    stuck_m: float = 0.0
    sigma_m: float = math.inf

    def pursuing(self, setpoint_m: float, span_m: float) -> Pushes:
        """Return the same for a new setpoint, or none if it lies elsewhere."""
        if self.anchor_m is not None and abs(setpoint_m - self.anchor_m) <= _ELSEWHERE_OF_SPAN * span_m:
            return self
        return Pushes(0, setpoint_m)

    def judged(self, *, moved: bool, time_s: float, rest_m: float, sigma_m: float) -> Pushes:
        """Return what is remembered after a push that moved the stem, or failed, as it turned out at `time_s`.

        The push was made from `rest_m`, known to `sigma_m`. If that is another place, the stem has moved after all.
        """
        if moved:
            return Pushes(0, self.anchor_m)
        if self.has_moved(rest_m, sigma_m):
            return Pushes(1, self.anchor_m, untold=True, stuck_m=rest_m, sigma_m=sigma_m)
        failed = self.failed + 1
        stuck = (self.stuck_m, self.sigma_m) if self.failed else (rest_m, sigma_m)
        # the exponent is bounded: a jam may last for years
        doubled = min(max(failed - MOST_FAILED, 0), 10)
        rest_s = min(_FIRST_REST_S * 2.0**doubled, _LONGEST_REST_S) if failed >= MOST_FAILED else 0.0
        return Pushes(failed, self.anchor_m, time_s + rest_s, rest_s, True, *stuck)

    def has_moved(self, rest_m: float, sigma_m: float) -> bool:
        """Whether a stem that rests at `rest_m` has moved since the first failure, beyond doubt."""
        return abs(rest_m - self.stuck_m) > _BEYOND_DOUBT * math.hypot(sigma_m, self.sigma_m)

    def may_push(self, time_s: float) -> bool:
        """Whether the law may push at `time_s`."""
        return time_s >= self.rests_until_s - _INSTANT_S
