"""The parameters of a valve that a law has fitted to its moves, with their covariance; they outlive a restart. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable

_Positive = Annotated[float, Interval(gt=0.0, le=1e9)]
_Variance = Annotated[float, Interval(ge=0.0, le=1e18)]
_Covariance = Annotated[float, Interval(ge=-1e18, le=1e18)]
_Lag = Annotated[float, Interval(ge=0.0, le=60.0)]

_STATIC_PER_DAY, _SPRING_PER_DAY, _LAG_PER_DAY = 0.02, 0.002, 0.02
"""Standard deviations of the change in a day, as parts: packing that rests sticks harder or dries out."""
_MOST_DAYS = 3650
_DAY_S = 86_400
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class ValveFit(SettingsTable):
    """K (k), F_s (f) and the lag (t) with their covariance.

    The variance of the lag is relative, for both lags together. friction_doubt: the relative error of F_s to expect
    from one slip to the next. sliding_n: F_c; sliding_n2: its variance.
    """

    spring_n_per_m: _Positive
    static_n: _Positive
    fill_s: _Lag
    vent_s: _Lag
    kk: _Variance
    kf: _Covariance
    kt: _Covariance
    ff: _Variance
    ft: _Covariance
    tt: _Variance
    friction_doubt: Annotated[float, Interval(gt=0.0, le=1.0)]
    sliding_n: _Positive
    sliding_n2: _Variance

    def __post_init__(self) -> None:
        """Refuse numbers that are no covariance: a correlation beyond 1."""
        for one, other, both in ((self.kk, self.ff, self.kf), (self.kk, self.tt, self.kt), (self.ff, self.tt, self.ft)):
            if both * both > (1.0 + _ROUNDING) * one * other:
                raise ValueError("the covariance is impossible: a correlation exceeds 1")

    def aged(self, seconds: int) -> ValveFit:
        """Return the fit after a time off; whole days count, so that a replay on the same day gives the same bits."""
        days = float(min(max(seconds, 0) // _DAY_S, _MOST_DAYS))
        if days == 0.0:
            return self
        grown = math.sqrt(days)
        spring, static = _SPRING_PER_DAY * grown * self.spring_n_per_m, _STATIC_PER_DAY * grown * self.static_n
        sliding, lag = _STATIC_PER_DAY * grown * self.sliding_n, _LAG_PER_DAY * grown
        return replace(
            self,
            kk=self.kk + spring * spring,
            ff=self.ff + static * static,
            tt=self.tt + lag * lag,
            sliding_n2=self.sliding_n2 + sliding * sliding,
        )
