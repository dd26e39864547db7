"""How often a push may fail to free the stem before the law rests, and for how long it rests. Pure.

The law `paper` goes on with its plan where a push has failed. A stem that twenty pushes do not free is jammed, or the
law is wrong about it: more pushes only wear the actuator. The law then rests for a second, tries once, rests for twice
as long, and so on up to a minute, until the stem has certainly moved. A setpoint at another place is pursued at once.
A setpoint that only trembles or creeps counts as the same one.
"""

from __future__ import annotations

import math

from positioner.values import dataclass

MOST_FAILED = 20
"""After so many failed pushes in a row the law rests."""
_FIRST_REST_S = 1.0
_LONGEST_REST_S = 60.0
_ELSEWHERE_OF_SPAN = 0.01
"""A setpoint farther away than this is at another place."""
_BEYOND_DOUBT = 5.0
"""Standard deviations beyond which the stem has certainly moved."""
_INSTANT_S = 1e-9
"""Rounding of a sum of periods."""


@dataclass(frozen=True, slots=True)
class Pushes:
    """What a law remembers of its failed pushes.

    failed: those since the stem last moved or the setpoint went to another place. anchor_m: the setpoint at that time.
    rests_until_s: in the law's time. rest_s: the length of the rest that the last failure began, 0 for none.
    stuck_m, sigma_m: where the stem was at the first one.
    """

    failed: int = 0
    anchor_m: float | None = None
    rests_until_s: float = 0.0
    rest_s: float = 0.0
    stuck_m: float = 0.0
    sigma_m: float = math.inf

    def for_setpoint(self, setpoint_m: float, span_m: float) -> Pushes:
        """Return the pushes that count for a setpoint: none, if it is at another place."""
        if self.anchor_m is not None and abs(setpoint_m - self.anchor_m) <= _ELSEWHERE_OF_SPAN * span_m:
            return self
        return Pushes(anchor_m=setpoint_m)

    def after_push(self, *, moved: bool, time_s: float, rest_m: float, sigma_m: float) -> Pushes:
        """Return the pushes after one more; `moved`, known at `time_s`, is whether it moved the stem.

        The push was made from `rest_m`, known to `sigma_m`. If that is another place than that of the first failed
        push, the stem has moved in between.
        """
        if moved:
            return Pushes(anchor_m=self.anchor_m)
        if self.has_moved(rest_m, sigma_m):
            return Pushes(1, self.anchor_m, stuck_m=rest_m, sigma_m=sigma_m)
        failed = self.failed + 1
        stuck_m, stuck_sigma_m = (self.stuck_m, self.sigma_m) if self.failed else (rest_m, sigma_m)
        # the exponent is bounded: a jam may last for years
        doubled = min(max(failed - MOST_FAILED, 0), 10)
        rest_s = min(_FIRST_REST_S * float(1 << doubled), _LONGEST_REST_S) if failed >= MOST_FAILED else 0.0
        return Pushes(
            failed,
            self.anchor_m,
            rests_until_s=time_s + rest_s,
            rest_s=rest_s,
            stuck_m=stuck_m,
            sigma_m=stuck_sigma_m,
        )

    def has_moved(self, rest_m: float, sigma_m: float) -> bool:
        """Whether a stem that rests at `rest_m` has certainly moved since the first failure."""
        return abs(rest_m - self.stuck_m) > _BEYOND_DOUBT * math.hypot(sigma_m, self.sigma_m)

    def may_push(self, time_s: float) -> bool:
        """Whether the law may push at `time_s`."""
        return time_s >= self.rests_until_s - _INSTANT_S
