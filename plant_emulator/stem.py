"""The stem from event to event: at rest, breaking away, creeping, sliding; Karnopp's eq. 3 without a time step. Pure.

Inside the zero-speed band (|v| < DV) a stem that static friction can hold is at rest for good. One that it cannot hold
moves against F_s, until it leaves the band or the pull falls to what friction holds. On the band's edge, viscous
friction may make a pull that starts the stem too small to keep it sliding: it then creeps along at DV exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from plant_emulator.friction import CELL_WIDTH_M, Packing, after_crossing, after_stop, stribeck_n
from plant_emulator.leg import Ending, Leg
from plant_emulator.legs import break_away, coast, creep
from plant_emulator.mechanics import FORCE_MARGIN_N, Mechanics, located_n
from plant_emulator.stribeck import StribeckSlide

if TYPE_CHECKING:
    from plant_emulator.oscillator import PushingForce


_SETTLED_M_PER_S = 1e-10
"""Speed at which a frictionless stem in balance is at rest: what is left of its way is lost in rounding."""


@dataclass(slots=True)
class Stem:
    """A moving stem; mutable, and alive only while one step is worked out."""

    mechanics: Mechanics
    position_m: float
    velocity_m_per_s: float
    direction: int
    """+1 or -1 while it moves, 0 at rest."""
    last_direction: int
    packing: Packing
    slips: int
    stops: int
    reversals: int
    travel_m: float

    def advance(self, force: PushingForce, duration_s: float) -> None:
        """Move for `duration_s` under `force`, from event to event."""
        left_s = duration_s
        while left_s > 0.0:
            leg = self._leg(force, left_s)
            self.travel_m += abs(leg.position_m - self.position_m)
            self.position_m = leg.position_m
            self.velocity_m_per_s = leg.velocity_m_per_s
            if leg.ending is Ending.BORDER:
                self._meet_border()
            elif leg.ending is Ending.BALANCE:
                self._stop()
            if leg.duration_s >= left_s:
                return
            left_s -= leg.duration_s
            force = force.after(leg.duration_s)

    def friction_n(self, push_n: float) -> float:
        """Return the friction force on the stem, positive against opening motion, under the force `push_n`."""
        pull = self._pull(push_n)
        speed, band = abs(self.velocity_m_per_s), self.mechanics.band_m_per_s
        static_n = self.packing.static_n
        if self.direction == 0:
            return min(max(pull, -static_n), static_n)
        if speed < band:
            return math.copysign(static_n, pull)
        sliding_n = self._sliding_n(speed)
        if speed == band and static_n < self.direction * pull <= sliding_n:
            return pull
        return self.direction * sliding_n

    def _leg(self, force: PushingForce, left_s: float) -> Leg:
        """Return the next stretch of motion; what it is depends on the speed and on the pull."""
        if self.direction == 0:
            return self._rest(force, left_s)
        pull = self._pull(force.at(0.0))
        if self._is_balanced(pull):
            return Leg(0.0, self.position_m, 0.0, Ending.BALANCE)
        if abs(self.velocity_m_per_s) > self.mechanics.band_m_per_s:
            return self._slide(force, left_s)
        return self._start(force, left_s, pull)

    def _is_balanced(self, pull: float) -> bool:
        """Return whether static friction holds the stem, or nothing moves a frictionless one any more."""
        speed, band = abs(self.velocity_m_per_s), self.mechanics.band_m_per_s
        enough_n = max(self.packing.static_n, FORCE_MARGIN_N)
        return abs(pull) <= enough_n and speed <= (band if self.mechanics.sticks else _SETTLED_M_PER_S)

    def _start(self, force: PushingForce, left_s: float, pull: float) -> Leg:
        """Return the stretch inside the zero-speed band or from its edge, of a stem that `pull` does not let rest."""
        mechanics, packing, x, v = self.mechanics, self.packing, self.position_m, self.velocity_m_per_s
        band, along = mechanics.band_m_per_s, 1 if pull > 0.0 else -1
        if v == 0.0:
            self._turn(along)
        border_m = self._border_m()
        if abs(v) < band or along != self.direction:
            return break_away(mechanics, x, v, along, force, packing.static_n, left_s, border_m)
        edge_n = self._sliding_n(band)
        quickest_n_per_s = abs(force.slope(0.0)) + mechanics.settings.valve.spring_rate_n_per_m * band
        margin_n = max(FORCE_MARGIN_N, 2.0 * located_n(quickest_n_per_s))
        if not mechanics.sticks or abs(pull) > edge_n + 0.5 * margin_n:
            return self._slide(force, left_s)
        return creep(mechanics, x, along, force, packing.static_n, edge_n + margin_n, left_s, border_m)

    def _rest(self, force: PushingForce, left_s: float) -> Leg:
        """Return the rest until the pressure overcomes static friction; the travel stops hold any force."""
        valve = self.mechanics.settings.valve
        balance_n = valve.bench_set_n + valve.spring_rate_n_per_m * self.position_m
        hold_n = max(self.packing.static_n, FORCE_MARGIN_N) + FORCE_MARGIN_N
        # a pull on its way back is at the limit, not above it, where the stop before was located
        hair_n = located_n(force.slope(0.0))
        up_n, down_n = balance_n + hold_n + max(0.0, -hair_n), balance_n - hold_n - max(0.0, hair_n)
        up_s = force.time_above(up_n) if self.position_m < valve.travel_max_m else math.inf
        down_s = force.time_below(down_n) if self.position_m > valve.travel_min_m else math.inf
        slip_s = min(up_s, down_s)
        if slip_s >= left_s:
            return Leg(left_s, self.position_m, 0.0, Ending.OPEN)
        self.slips += self.mechanics.sticks
        self._turn(1 if up_s < down_s else -1)
        return Leg(slip_s, self.position_m, 0.0, Ending.OPEN)

    def _slide(self, force: PushingForce, left_s: float) -> Leg:
        mechanics, packing = self.mechanics, self.packing
        x, v, border_m = self.position_m, self.velocity_m_per_s, self._border_m()
        if abs(v) > mechanics.flat_m_per_s or mechanics.flat_m_per_s == mechanics.band_m_per_s:
            return coast(mechanics, x, v, self.direction, force, packing.coulomb_n, left_s, border_m)
        valve = mechanics.settings.valve
        slide = StribeckSlide(
            force=force,
            sign=self.direction,
            mass_kg=valve.mass_kg,
            spring_n_per_m=valve.spring_rate_n_per_m,
            viscous_n_s_per_m=valve.viscous_friction_n_s_per_m,
            load_n=valve.bench_set_n + self.direction * packing.coulomb_n,
            drop_n=packing.static_n - packing.coulomb_n,
            stribeck_velocity_m_per_s=valve.stribeck_velocity_m_per_s,
        )
        return slide.run(x, v, left_s, mechanics.band_m_per_s, mechanics.flat_again_m_per_s, border_m)

    def _pull(self, push_n: float) -> float:
        """Return F_e of eq. 3 in N."""
        valve = self.mechanics.settings.valve
        return push_n - valve.bench_set_n - valve.spring_rate_n_per_m * self.position_m

    def _sliding_n(self, speed_m_per_s: float) -> float:
        """Return the size of the friction of eq. 4 in N."""
        valve, packing = self.mechanics.settings.valve, self.packing
        dry_n = stribeck_n(speed_m_per_s, packing.static_n, packing.coulomb_n, valve.stribeck_velocity_m_per_s)
        return dry_n + valve.viscous_friction_n_s_per_m * speed_m_per_s

    def _border_m(self) -> float:
        """Return the next border in the direction of motion: a travel stop, or the end of a friction cell."""
        valve = self.mechanics.settings.valve
        opening = self.direction > 0
        stop_m = valve.travel_max_m if opening else valve.travel_min_m
        if not self.mechanics.is_stochastic:
            return stop_m
        cell_m = (self.packing.cell + opening) * CELL_WIDTH_M
        return min(stop_m, cell_m) if opening else max(stop_m, cell_m)

    def _meet_border(self) -> None:
        valve = self.mechanics.settings.valve
        if self.position_m in (valve.travel_min_m, valve.travel_max_m):
            self._stop()
        else:
            self.packing = after_crossing(self.mechanics.settings, self.packing, self.direction)

    def _stop(self) -> None:
        self.direction = 0
        self.velocity_m_per_s = 0.0
        self.stops += self.mechanics.sticks
        self.packing = after_stop(self.mechanics.settings, self.packing, self.stops)

    def _turn(self, direction: int) -> None:
        self.reversals += self.last_direction == -direction
        self.direction = self.last_direction = direction
