"""Friction, spring rate and offset against the reference, from the moves in service. Pure.

A move shows y = F_0 + K·x̄ ± F_c (see `moves`). Against the reference that is
    y - y_ref = ΔF_0 + ΔK·x̄ ± F_c,ref·φ,
so friction is what differs between the two directions. A change common to both is of the spring, the supply, the I/P
converter or the process. The three are found together by least squares, each move weighing (1-λ) times as much as the
next one. The F_s of each slip under a current that rose slowly is compared with the spring so found.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeAlias

from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.health.move import Move
    from positioner.health.reference import Reference

_SCATTER = 0.05
"""Of F_c: the standard deviation from move to move that is expected at least."""
_KNOWN, _ANYTHING = 1e4, 1.0
"""1/σ² of what is known of each change before the first move (1 %), and of what is always known (100 %)."""
_HUBER = 2.5
"""Standard deviations beyond which a move counts less."""
_USELESS = 1.0
"""Of F_c: a move whose noise is larger shows nothing."""
_COARSE, _LEAST = 0.1, 0.2
"""Of F_s: the largest half step of the current at a slip that shows F_s, and the least F_s that is believed."""
_ONE_SIDED, _SPRING_SEEN = 0.6, 0.05
"""One direction alone changes where the change common to both is more than this part of what sets them apart, and the
spring rate has changed by less than that."""
_Z = 1.96
_Symmetric: TypeAlias = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Share:
    """A change as a part of the reference (0.2 is +20 %), and its standard deviation."""

    value: float
    sigma: float

    @property
    def low(self) -> float:
        """The lower end of the 95 % interval."""
        return self.value - _Z * self.sigma

    @property
    def high(self) -> float:
        """The upper end of the 95 % interval."""
        return self.value + _Z * self.sigma


@dataclass(frozen=True, slots=True)
class FrictionTrend:
    """The averages, at the reference to begin with.

    normal: the sums of products of offset, spring and friction (oo, os, of, ss, sf, ff), as parts of the reference;
    right: the sums with the change seen. scatter: mean square of a residual, 1 where moves scatter as expected.
    static_log: mean of log(F_s/F_s,ref), and static_moves how many have shown it.
    moves: how many were used, and moves_up of them opening; at_s: the last one.
    """

    normal: _Symmetric = (_KNOWN, 0.0, 0.0, _KNOWN, 0.0, _KNOWN)
    right: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scatter: float = 1.0
    static_log: float = 0.0
    static_moves: int = 0
    moves: int = 0
    moves_up: int = 0
    at_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Changes:
    """What has changed since the reference.

    friction: of F_c; spring: of K; offset: of the spring's force in the middle of the moves, as a part of its force
    over the span; static: of F_s, None while too few slips have shown it. jump: the change of the slip jump
    2·(F_s - F_c)/K, as a part of the span.
    one_sided: only one direction has changed, as a supply or a converter at its limit makes it: this is no friction.
    """

    friction: Share
    spring: Share
    offset: Share
    static: Share | None
    jump: Share | None
    one_sided: bool


def after_move(trend: FrictionTrend, reference: Reference, averaging: float, move: Move) -> FrictionTrend:
    """Return the trend after a move; `averaging` is λ."""
    if not move.complete:
        return trend
    sliding_n = reference.sliding_along_n(move.before_m, move.after_m)
    sigma_n = math.hypot(_SCATTER * sliding_n, move.force_sigma_n)
    if sigma_n > _USELESS * sliding_n:
        return trend
    spring_n = reference.spring_n_per_m
    offset, spring = spring_n * reference.span_m / sigma_n, spring_n * move.middle_m / sigma_n
    friction = move.friction_part * sliding_n / sigma_n
    seen = (move.force_n - reference.balance_n(move.middle_m)) / sigma_n - friction
    before = _solved(_inverse(trend), trend.right)
    left = seen - offset * before[0] - spring * before[1] - friction * before[2]
    weight = min(1.0, _HUBER / max(abs(left), 1e-9))
    # a move that shows less makes the trend forget less
    known = _SCATTER * sliding_n / sigma_n
    fading = averaging * known * known
    keep, fade = 1.0 - fading, fading * _ANYTHING
    oo, os, of, ss, sf, ff = trend.normal
    normal = (
        keep * oo + weight * offset * offset + fade,
        keep * os + weight * offset * spring,
        keep * of + weight * offset * friction,
        keep * ss + weight * spring * spring + fade,
        keep * sf + weight * spring * friction,
        keep * ff + weight * friction * friction + fade,
    )
    r0, r1, r2 = trend.right
    seen *= weight
    after = replace(
        trend,
        normal=normal,
        right=(keep * r0 + offset * seen, keep * r1 + spring * seen, keep * r2 + friction * seen),
        scatter=keep * trend.scatter + fading * weight * left * left,
        moves=trend.moves + 1,
        moves_up=trend.moves_up + (move.direction > 0.0),
        at_s=move.at_s,
    )
    return _with_static(after, reference, averaging, move)


def _with_static(trend: FrictionTrend, reference: Reference, averaging: float, move: Move) -> FrictionTrend:
    """Return the trend with the F_s of a slip under a current that rose slowly, about the spring as it is now."""
    static_n = reference.static_at_n(move.before_m)
    if move.slip_half_n > _COARSE * static_n:
        return trend
    offset, spring, _ = _solved(_inverse(trend), trend.right)
    load_n = reference.preload_n + reference.spring_n_per_m * (
        offset * reference.span_m + (1.0 + spring) * move.before_m
    )
    seen_n = move.direction * (move.slip_n - load_n)
    if not _LEAST * static_n < seen_n < static_n / _LEAST:
        return trend
    change = math.log(seen_n / static_n) - trend.static_log
    return replace(trend, static_log=trend.static_log + averaging * change, static_moves=trend.static_moves + 1)


def is_possible(trend: FrictionTrend) -> bool:
    """Whether moves can have led to the trend: its matrix is positive definite, and F_s within what is believed."""
    try:
        inverse = _inverse(trend)
    except ZeroDivisionError:
        return False
    normal = trend.normal
    for value in (normal[0], normal[3], normal[5], inverse[0], inverse[3], inverse[5]):
        if not 0.0 < value < math.inf:
            return False
    offset, spring, friction = _solved(inverse, trend.right)
    return (
        math.isfinite(offset + spring + friction)
        and trend.scatter >= 0.0
        and abs(trend.static_log) <= math.log(1.0 / _LEAST)
        and trend.moves_up <= trend.moves
    )


def changes(trend: FrictionTrend, reference: Reference, averaging: float) -> Changes:
    """Return what has changed since the reference; `averaging` is λ."""
    inverse = _inverse(trend)
    offset, spring, friction = _solved(inverse, trend.right)
    # the variance of a sum with fading weights, over that of a sum of all its observations
    spread = math.sqrt(max(trend.scatter, 1.0) / (2.0 - averaging))
    middle = trend.normal[1] / trend.normal[0]  # of the moves, as a part of the span
    oo, os, _, ss, _, ff = inverse
    common = Share(
        offset + spring * middle, spread * math.sqrt(max(oo + 2.0 * middle * os + middle * middle * ss, 0.0))
    )
    apart = Share(friction, spread * math.sqrt(ff))
    static = jump = None
    if trend.static_moves * averaging >= 1.0:  # a mean of few slips lags behind that of all moves
        change = math.expm1(trend.static_log)
        sigma = _SCATTER * math.sqrt(averaging / (2.0 - averaging) + 1.0 / trend.static_moves)
        static = Share(change, (1.0 + change) * sigma)
        stiff_n = reference.spring_n_per_m * reference.span_m
        more_n = static.value * reference.static_n - friction * reference.sliding_n
        jump_sigma = math.hypot(static.sigma * reference.static_n, apart.sigma * reference.sliding_n)
        jump = Share(2.0 * more_n / stiff_n, 2.0 * jump_sigma / stiff_n)
    common_n = common.value * reference.spring_n_per_m * reference.span_m
    one_sided = abs(common_n) > _ONE_SIDED * abs(friction) * reference.sliding_n and abs(spring) < _SPRING_SEEN
    return Changes(apart, Share(spring, spread * math.sqrt(ss)), common, static, jump, one_sided)


def _solved(inverse: _Symmetric, right: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the changes of offset, spring and friction by least squares."""
    a, b, c, d, e, f = inverse
    r0, r1, r2 = right
    return a * r0 + b * r1 + c * r2, b * r0 + d * r1 + e * r2, c * r0 + e * r1 + f * r2


def _inverse(trend: FrictionTrend) -> _Symmetric:
    """Return the inverse of the symmetric matrix of three rows; it is positive definite."""
    a, b, c, d, e, f = trend.normal
    first, second, third = d * f - e * e, c * e - b * f, b * e - c * d
    size = 1.0 / (a * first + b * second + c * third)
    return (
        size * first,
        size * second,
        size * third,
        size * (a * f - c * c),
        size * (b * c - a * e),
        size * (a * d - b * b),
    )
