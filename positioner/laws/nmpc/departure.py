"""The start of a move: its push, its aim, and whether it first backs off. Pure.

The smallest push carries the stem some way, however near the setpoint is: one sample of at least Γ, then braking. At a
long sample period this way is several millimetres. A setpoint that is nearer is reached by two moves: back, to where
the way is long enough, and from there to the setpoint.

Where Γ is more than the loop can give, full current is tried, since Γ is an estimate. The move is then planned for the
nearest load, by its covariance, that this current frees: if the stem moves, its motion teaches the load as any other.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.breakaway import breakaway
from positioner.laws.nmpc.landing import landing_bias_m
from positioner.laws.nmpc.move import Move, move_of
from positioner.values import dataclass, replace
from positioner.valve.motion import Load

if TYPE_CHECKING:
    from positioner.laws.move_reason import Breakaway
    from positioner.laws.nmpc.filter import AdaptiveFilter, Resting, Sliding
    from positioner.laws.nmpc.settings import NmpcSettings
    from positioner.valve.stiction import StictionTable


@dataclass(frozen=True, slots=True)
class Departure:
    """The start of a move: its aim in m, Γ, the push in mA, the stem that it frees, and the move.

    frees: whether the load as it is estimated lets the push free the stem. shortest_m: the way of the smallest push.
    """

    aim_m: float
    gamma: Breakaway
    release_ma: float
    sliding: Sliding
    move: Move
    frees: bool
    shortest_m: float


@dataclass(frozen=True, slots=True)
class Departing:
    """What every start of a move needs: settings, filter, limits of the current in mA, and the period in s.

    unforeseen: the factor of the noise of a motion.
    """

    settings: NmpcSettings
    filter: AdaptiveFilter
    limits_ma: tuple[float, float]
    period_s: float
    unforeseen: float

    def to(self, here: Resting, setpoint_m: float, ratio: float, table: StictionTable) -> Departure:
        """Return the start of the move to the setpoint, or of the one that backs off before it; `ratio` is F_s/F_c."""
        error_m = setpoint_m - here.x
        direction = math.copysign(1.0, error_m)
        direct = self._towards(here, setpoint_m, direction, ratio, table)
        way_m = direct.shortest_m
        if way_m - abs(error_m) <= self.settings.tolerance_m + here.sigma_m:
            return direct
        back_m = _SPARE * way_m - abs(error_m)
        back = self._towards(here, here.x - direction * back_m, -direction, ratio, table)
        if not back.frees:
            return direct
        if back.shortest_m > back_m:
            # the smallest push back goes farther
            back = self._towards(here, here.x - direction * _SPARE * back.shortest_m, -direction, ratio, table)
        return back

    def _towards(
        self, here: Resting, place_m: float, direction: float, ratio: float, table: StictionTable
    ) -> Departure:
        """Return the start of the move to a place."""
        own, model, load = self.settings, self.filter.model, here.load
        static_n = ratio * load.friction_n
        gamma = breakaway(own.breakaway, model, table, here.x, direction, load.spring_n_per_m, static_n)
        low_ma, high_ma = self.limits_ma
        release_ma = min(max(gamma.current_ma, low_ma), high_ma)
        sliding = self.filter.depart(here, direction, self.unforeseen)
        frees = direction * (gamma.current_ma - release_ma) <= 0.0
        if not frees:
            most_n = model.push_n(release_ma, 0.0, 0.0)
            sliding = self._freed(sliding, most_n, ratio * (1.0 + own.breakaway.margin))
        aim_m = place_m - landing_bias_m(table, place_m, direction)
        static_n = ratio * sliding.load.friction_n
        move = move_of(own, model, sliding, aim_m, static_n, self.limits_ma, release_ma)
        shortest_m = direction * (move.smallest_m(move.slide(model, self.period_s)) - here.x)
        return Departure(aim_m, gamma, release_ma, sliding, move, frees, shortest_m)

    def _freed(self, sliding: Sliding, force_n: float, ratio: float) -> Sliding:
        """Return the stem with the nearest load that `force_n` frees: K x ± `ratio` F_c is this force."""
        p, load, x, c = sliding.covariance, sliding.load, sliding.x, sliding.direction * ratio
        by_k, by_f, by_c = x * p.kk + c * p.kf, x * p.kf + c * p.ff, x * p.kc + c * p.fc
        missing_n = force_n - load.spring_n_per_m * x - c * load.friction_n
        change = missing_n / (x * by_k + c * by_f)
        freed = Load(
            load.spring_n_per_m + change * by_k,
            load.friction_n + change * by_f,
            load.viscous_n_s_per_m + change * by_c,
        )
        return replace(sliding, load=self.filter.limited(freed))


_SPARE = 1.15
"""How much longer than the smallest push a move is planned."""
