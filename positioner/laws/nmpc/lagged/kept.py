"""What the law keeps over a restart: K, F_s, F_c and the lags with their covariance. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.regression import OnsetRegression
from positioner.values import replace
from positioner.valve.fit import ValveFit

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.memory import LaggedMemory
    from positioner.laws.nmpc.lagged.valve import LaggedValve

_SPRING, _STATIC, _LAG = 0.003, 0.02, 0.02
"""What a restart adds to the doubt, as parts: nobody knows what happened meanwhile."""
_LEAST_DOUBT = 0.05
_NOT_USED = "the K, F_s, F_c or lag that the table keeps is not of the configured valve, and is not used"


def fit_of(memory: LaggedMemory) -> ValveFit:
    """Return what is to be kept of the valve as it is known now."""
    belief, drive, measured = memory.belief, memory.drive, memory.measured
    onsets = belief.onsets
    kt, ft, tt = onsets.kt, onsets.ft, onsets.tt
    if measured is not None and measured.is_used:
        kt, ft, tt = 0.0, 0.0, max(measured.ff, measured.vv)
    return ValveFit(
        onsets.spring_n_per_m,
        onsets.static_n,
        drive.fill_s,
        drive.vent_s,
        onsets.kk,
        _correlated(onsets.kf, onsets.kk, onsets.ff),
        _correlated(kt, onsets.kk, tt),
        onsets.ff,
        _correlated(ft, onsets.ff, tt),
        tt,
        belief.doubt,
        onsets.sliding_n,
        onsets.cc,
    )


def with_fit(valve: LaggedValve, memory: LaggedMemory, fit: ValveFit) -> LaggedMemory:
    """Return the memory with what was kept; its doubt is never more than that of the configured values."""
    prior, base = memory.belief, valve.drive
    fill, vent = _ratio(fit.fill_s, base.fill_s), _ratio(fit.vent_s, base.vent_s)
    restart_n = _STATIC * fit.sliding_n
    found = OnsetRegression(
        fit.spring_n_per_m,
        fit.static_n,
        fill,
        fit.sliding_n,
        fit.kk,
        fit.kf,
        fit.kt,
        0.0,
        fit.ff,
        fit.ft,
        0.0,
        fit.tt if valve.has_lag else 0.0,
        0.0,
        fit.sliding_n2 + restart_n * restart_n,
    ).loosened(_SPRING * valve.spring_n_per_m, _STATIC * valve.static_n, _LAG if valve.has_lag else 0.0)
    kept = valve.within(found)
    is_ours = (
        kept.spring_n_per_m == found.spring_n_per_m
        and kept.static_n == found.static_n
        and kept.lag == fill
        and _LEAST_LAG < vent < _MOST_LAG
        and kept.sliding_n == found.sliding_n
    )
    if not is_ours:
        return replace(memory, notice=_NOT_USED)
    onsets = kept.no_looser(prior.onsets.kk, prior.onsets.ff, prior.onsets.tt, prior.onsets.cc)
    doubt = min(max(fit.friction_doubt, _LEAST_DOUBT), prior.doubt)
    belief = replace(prior, onsets=onsets, doubt=doubt)
    # a filter of the pressure begins anew, with these lags
    return replace(memory, belief=belief, drive=base.with_lags(fit.fill_s, fit.vent_s), measured=None)


def _ratio(kept_s: float, configured_s: float) -> float:
    if configured_s == 0.0:
        return 1.0 if kept_s == 0.0 else math.inf
    return kept_s / configured_s


def _correlated(both: float, one: float, other: float) -> float:
    """Return a covariance after rounding: no correlation exceeds 1."""
    most = math.sqrt(max(one, 0.0) * max(other, 0.0))
    return min(max(both, -most), most)


_LEAST_LAG, _MOST_LAG = 0.4, 2.0
