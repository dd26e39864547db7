"""An experiment where push after push fails: the same push, not quite as strong, is held. Pure.

A push of one sample fails where the friction is larger than believed, and where the pressure has no time to rise. A
force that is less than one which failed frees no stem without lag, however long it lasts; behind a lag it does. So the
experiment does no harm where there is no lag, and where there is one its motion has no other explanation.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.untold.watch import Quiet

MOST = 3
"""So many experiments tell what there is to tell."""
LEAST_READINGS = 8
"""At rest before one."""
_SHARES = (0.75, 1.0)
"""The force of the first one and of the later ones, as a part of that which failed."""
_FIRST_S = 0.012
"""How long the first one lasts at most; each may last four times as long as the one before."""
_RECENT = 0.4
"""Weight of the newest reading in their smoothed mean."""
_SEEN, _SEEN_AT_REST = 4.0, 3.0
"""Standard deviations of the smoothed mean from the origin at which the stem must have moved."""
_STOPS_S = 0.01
"""After it the stem is left alone for so long."""


@dataclass(frozen=True, slots=True)
class Probe:
    """A push that is held.

    current_ma: the push; held_ma: before and after it. direction: ±1. origin_m: where the stem rests, with the variance
    of this average in m². left: samples for which it is held at most; stops: samples of rest after it. recent_m: the
    smoothed readings. has_moved: whether they show a motion.
    """

    current_ma: float
    held_ma: float
    direction: float
    origin_m: float
    variance_m2: float
    left: int
    stops: int
    recent_m: float
    has_moved: bool = False

    @property
    def is_held(self) -> bool:
        """Whether the push still lasts."""
        return self.left > 0

    @property
    def is_over(self) -> bool:
        """Whether the stem rests again."""
        return self.left == 0 and self.stops == 0

    def followed_by(self, measured_m: float, noise_m2: float) -> Probe:
        """Return the experiment one sample later: a motion that is seen ends the push."""
        recent_m = self.recent_m + _RECENT * (measured_m - self.recent_m)
        variance_m2 = self.variance_m2 + noise_m2 * _RECENT / (2.0 - _RECENT)
        seen_m = (_SEEN if self.is_held else _SEEN_AT_REST) * math.sqrt(variance_m2)
        has_moved = self.has_moved or self.direction * (recent_m - self.origin_m) > seen_m
        if not self.is_held:
            return replace(self, recent_m=recent_m, has_moved=has_moved, stops=max(self.stops - 1, 0))
        return replace(self, recent_m=recent_m, has_moved=has_moved, left=0 if has_moved else self.left - 1)


def probe_of(
    quiet: Quiet, noise_m2: float, held_ma: float, push_ma: float, gamma_ma: float, count: int, period_s: float
) -> Probe:
    """Return the experiment number `count` (from 0) in place of a push of `push_ma`, at least `gamma_ma`."""
    direction = math.copysign(1.0, push_ma - held_ma)
    weaker_ma = held_ma + _SHARES[min(count, 1)] * (push_ma - held_ma)
    # no weaker than Γ, and no stronger than the push
    current_ma = max(weaker_ma, min(gamma_ma, push_ma)) if direction > 0.0 else min(weaker_ma, max(gamma_ma, push_ma))
    lasts_s = _FIRST_S * math.ldexp(1.0, 2 * count)
    samples, stops = max(round(lasts_s / period_s), 2), max(round(_STOPS_S / period_s), 1)
    return Probe(
        current_ma,
        held_ma,
        direction,
        quiet.mean_m,
        noise_m2 / max(quiet.readings, 1),
        samples,
        stops,
        quiet.mean_m,
    )
