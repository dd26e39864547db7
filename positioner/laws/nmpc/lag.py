"""How late a valve follows its commands, seen in one move. Pure.

A pressure that goes from p_0 to the level L with the lag τ frees the stem at p_b, after
t_b = τ ln((L - p_0)/(L - p_b)). From there the stem follows its balance. At the end of the move, after T, it is at x_T;
the area between this place and its way is

    ∫ (x_T - x) dt = m t_b + (L - p_b)/k (τ (1 - e) - (T - t_b) e),    e = exp(-(T - t_b)/τ),    m = x_T - x_0

The left side is a sum of readings, so noise averages out, and no instant has to be recognised in it. The right side
grows with τ. A dead time and all lags in a row look like one lag of their sum.
"""

from __future__ import annotations

import math

from positioner.values import dataclass
from positioner.valve.actuator import left_of_lag

_LEAST_GAP = 0.02
"""Of the step: what is left of it when the stem is freed, at least; less is within the doubt of F_s."""
_LONGER, _LESS, _NEW_LAG = 0.3, 0.4, 0.4
"""A lag that is seen 30 % longer than believed is another one, and one that is 40 % shorter: what is believed of
spring and friction at first makes it up to 20 % wrong. Weight of the newest in the mean of those seen."""
PATIENCE_S, MORE_PATIENCE_S = 0.2, 1.0
"""How long a push is held that should free the stem and does not, while no move has shown the lag: the first one, and
each further one. Most such stems stick harder than configured, fewer are late: on all valves of the robustness test 1,
0.5, 0.3 and 0.2 s for all of them lose 390, 378, 375 and 370 dwells (DESIGN.md, "The law `quasi-static`"). A pressure
that is late by 0.3 s has done 96 % of its step after 1 s."""
_BISECTIONS = 24
"""The lag is found to 2^-24 of the length of the move."""


@dataclass(frozen=True, slots=True)
class Way:
    """One move.

    step_ma, gap_ma: L - p_0 and L - p_b; moved_m: x_T - x_0; all positive, also downwards. spring_ma_per_m: k = K/B.
    lasted_s: T.
    """

    step_ma: float
    gap_ma: float
    spring_ma_per_m: float
    moved_m: float
    lasted_s: float

    def area_m_s(self, lag_s: float) -> float:
        """Return the area in m s of a valve with this lag."""
        if lag_s <= 0.0:
            return 0.0
        free_s = min(lag_s * math.log(self.step_ma / self.gap_ma), self.lasted_s)
        left_s = self.lasted_s - free_s
        left = math.exp(-left_s / lag_s)
        sliding_m_s = self.gap_ma / self.spring_ma_per_m * (lag_s * (1.0 - left) - left_s * left)
        return self.moved_m * free_s + sliding_m_s

    def lag_s(self, area_m_s: float) -> float:
        """Return the lag that an area shows, at most the length of the move."""
        low_s, high_s = 0.0, self.lasted_s
        for _ in range(_BISECTIONS):
            lag_s = 0.5 * (low_s + high_s)
            if self.area_m_s(lag_s) < area_m_s:
                low_s = lag_s
            else:
                high_s = lag_s
        return 0.5 * (low_s + high_s)

    def sigma_s(self, sigma_m_s: float) -> float:
        """Return σ of the lag that an area shows, whose own σ is given."""
        return sigma_m_s / (self.moved_m * math.log(self.step_ma / self.gap_ma) + self.gap_ma / self.spring_ma_per_m)

    def after_ma(self, lag_s: float) -> float:
        """Return how much of the step is still to come at the end of the move."""
        return self.step_ma * left_of_lag(self.lasted_s, lag_s)


def way_of(step_ma: float, free_ma: float, spring_ma_per_m: float, moved_m: float, lasted_s: float) -> Way:
    """Return a move whose pressure, by what is believed, freed the stem after `free_ma` of its step; see `Way`."""
    gap_ma = min(max(step_ma - free_ma, _LEAST_GAP * step_ma), step_ma)
    return Way(step_ma, gap_ma, spring_ma_per_m, moved_m, lasted_s)


def more_lag_s(believed_s: float, seen_s: float, doubt_s: float, *, is_other: bool) -> float:
    """Return by how much the lag is longer than believed, 0 where it is not another one.

    Args:
        believed_s: the lag that is believed.
        seen_s: the lag that a move has shown.
        doubt_s: how far what was seen may be off.
        is_other: whether it is not the configured one that is believed.
    """
    more_s = seen_s - believed_s
    if -_LESS * believed_s - doubt_s < more_s < _LONGER * believed_s + doubt_s:
        return _NEW_LAG * more_s if is_other else 0.0
    return more_s
