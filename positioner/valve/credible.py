"""The credible range of each quantity in a stiction table; other values are neither learned nor used. Pure.

A table outlives the run in which it was learned; it is imported, restored and edited. A single absurd value in it can
move the stem by as much. So every sample must be possible for a valve whose spring and friction are between `least` and
`most` times the configured ones. The filter of the law `nmpc` estimates them within the same range.

Γ: the force that frees a stem at x lies between the spring and the least friction, and the spring and the most,
    B·Γ = k (K x + F_0) ± F with least ≤ k ≤ most and least·F_c ≤ F ≤ most·max(F_s, ratio_most·F_c) (eqs 25, 26).
v_Ag: a stem is never faster than the largest net force F of the loop makes it, neither against viscous friction,
    v = F/F_v, nor over the whole travel without any, v = √(2 F (x_max - x_min)/m).
Landing bias: the place x of a stop, less the one at which its pressure would have stopped the configured valve,
    x - (B p - F_0 - s F_c)/K with B p = k (K x + F_0) + s F: every credible valve stops somewhere else. F is
    F_c between least and most, or differs by the rise F_s - F_c as the stem comes to rest (eq. 4). A valve without
    friction is allowed 1 % of its span, for its sensor and play.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING

from positioner.values import dataclass, replace
from positioner.valve.stiction import Direction, LearnedSample, Quantity
from positioner.wire.loop_current import VALUE_HIGH_MA, VALUE_LOW_MA

if TYPE_CHECKING:
    from positioner.valve.parameters import ValveParameters
    from positioner.valve.stiction import StictionTable


@dataclass(frozen=True, slots=True)
class Limits:
    """The range of credible valves; least, most: of spring and friction, as fractions; ratio_most: of F_s/F_c."""

    valve: ValveParameters
    least: float = 0.6
    most: float = 1.5
    ratio_most: float = 2.0

    def range_of(
        self, quantity: Quantity, position_m: float, direction: Direction, reach_m: float = 0.0
    ) -> tuple[float, float]:
        """Return the smallest and the largest credible value of a quantity, in its unit, within `reach_m` of a place.

        Beyond the travel and 5 % of the span no value is credible: the smallest is then larger than the largest.
        """
        margin_m = _PLACE_OF_SPAN * self.valve.span_m + reach_m
        if not self.valve.travel_min_m - margin_m <= position_m <= self.valve.travel_max_m + margin_m:
            return math.inf, -math.inf
        match quantity:
            case Quantity.BREAKAWAY_CURRENT:
                return self._breakaway_ma(position_m - reach_m, position_m + reach_m, direction.sign)
            case Quantity.STICK_SPEED:
                return 0.0, self._fastest_m_per_s()
            case Quantity.LANDING_BIAS:
                return self._landing_m(position_m - reach_m, position_m + reach_m, direction.sign)

    def allows(self, sample: LearnedSample, reach_m: float = 0.0) -> bool:
        """Whether `sample`, learned within `reach_m` of its place, is credible."""
        low, high = self.range_of(sample.quantity, sample.position_m, sample.direction, reach_m)
        return low <= sample.value <= high

    def _landing_m(self, low_m: float, high_m: float, sign: float) -> tuple[float, float]:
        valve, springs_n, least_m = self.valve, self._springs_n(low_m, high_m), _LANDING_OF_SPAN * self.valve.span_m
        sliding_n, rise_n = valve.coulomb_friction_n, self.most * (valve.static_friction_n - valve.coulomb_friction_n)
        frictions_n = (sign * (self.least * sliding_n - rise_n), sign * (self.most * sliding_n + rise_n))
        rate, rests_n = valve.spring_rate_n_per_m, valve.bench_set_n + sign * sliding_n
        lowest_m = low_m - (max(springs_n) + max(frictions_n) - rests_n) / rate
        highest_m = high_m - (min(springs_n) + min(frictions_n) - rests_n) / rate
        return min(lowest_m, -least_m), max(highest_m, least_m)

    def _springs_n(self, low_m: float, high_m: float) -> list[float]:
        valve = self.valve
        return [
            share * (valve.spring_rate_n_per_m * place_m + valve.bench_set_n)
            for share in (self.least, self.most)
            for place_m in (low_m, high_m)
        ]

    def _breakaway_ma(self, low_m: float, high_m: float, sign: float) -> tuple[float, float]:
        valve, springs_n = self.valve, self._springs_n(low_m, high_m)
        most_n = self.most * max(valve.static_friction_n, self.ratio_most * valve.coulomb_friction_n)
        frictions_n = (sign * self.least * valve.coulomb_friction_n, sign * most_n)
        gain = valve.force_gain_n_per_ma
        return (min(springs_n) + min(frictions_n)) / gain, (max(springs_n) + max(frictions_n)) / gain

    def _fastest_m_per_s(self) -> float:
        valve = self.valve
        rate = self.most * valve.spring_rate_n_per_m
        opening_n = valve.force_gain_n_per_ma * VALUE_HIGH_MA - min(rate * valve.travel_min_m, 0.0)
        closing_n = rate * valve.travel_max_m + self.most * valve.bench_set_n - valve.force_gain_n_per_ma * VALUE_LOW_MA
        push_n = max(opening_n, closing_n)
        travel_m = valve.travel_max_m - valve.travel_min_m
        against_m_per_s = push_n / (self.least * valve.viscous_friction_n_s_per_m)
        return min(against_m_per_s, math.sqrt(2.0 * push_n * travel_m / valve.mass_kg))


_PLACE_OF_SPAN = 0.05
_LANDING_OF_SPAN = 0.01


def credible_part(limits: Limits, table: StictionTable) -> tuple[StictionTable, tuple[LearnedSample, ...]]:
    """Return the table with its credible samples only, and the excluded ones; the same table if there are none.

    The count of a cell that loses samples becomes the number of those that it keeps, so that a law that asks for a
    least count waits for new ones.
    """
    cells, excluded = dict(table.cells), list[LearnedSample]()
    for key, cell in table:
        place_m = key.index * table.cell_width_m
        low, high = limits.range_of(key.quantity, place_m, key.direction, table.cell_width_m / 2.0)
        kept = tuple(value for value in cell.samples if low <= value <= high)
        if len(kept) == len(cell.samples):
            continue
        excluded += [
            LearnedSample(key.quantity, place_m, key.direction, value)
            for value in cell.samples
            if not low <= value <= high
        ]
        if kept:
            cells[key] = replace(cell, samples=kept, count=len(kept))
        else:
            del cells[key]
    if not excluded:
        return table, ()
    return replace(table, cells=MappingProxyType(cells)), tuple(excluded)
