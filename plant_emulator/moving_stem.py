"""The stem from event to event: at rest, breaking away, creeping, sliding; Karnopp's eq. 3 without a time step. Pure.

Inside the zero-speed band (|v| < DV) a stem that static friction can hold comes to rest. A stem that static friction
cannot hold moves against F_s, until it leaves the band or the pull falls to F_s. At the edge of the band viscous
friction is added. A pull that starts the stem can then be too small to keep it sliding: the stem creeps at exactly DV.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from plant_emulator import friction
from plant_emulator.ageing import Ageing, growth
from plant_emulator.constants import FORCE_MARGIN_N, Constants, located_n
from plant_emulator.feedback import Feedback, after_motion, after_rest
from plant_emulator.friction import CELL_WIDTH_M, Packing, after_crossing, after_leaving, after_stop
from plant_emulator.path import Uniform
from plant_emulator.roots import clear_time, first_event
from plant_emulator.segment import Ending, Segment
from plant_emulator.segments import break_away, coast, creep
from plant_emulator.stem import Stem, pull_n, sliding_n
from plant_emulator.stribeck import StribeckSlide

if TYPE_CHECKING:
    from plant_emulator.force import PushingForce
    from plant_emulator.sensor_settings import SensorSettings


_SETTLED_M_PER_S = 1e-10
"""At this speed a frictionless stem in balance is at rest: its remaining distance is smaller than rounding errors."""


@dataclass(slots=True)
class MovingStem:
    """A stem, its packing and its feedback while one step is computed; mutable.

    time_s: plant time.
    feedback: None where the sensor shows the stem as it is.
    """

    constants: Constants
    stem: Stem
    packing: Packing
    time_s: float = 0.0
    feedback: Feedback | None = None

    def advance(self, force: PushingForce, duration_s: float) -> None:
        """Move for `duration_s` under `force`, from event to event."""
        left_s = duration_s
        while left_s > 0.0:
            stem = self.stem
            if stem.direction == 0 and self._is_held(stem, force, left_s):
                if self.constants.ages:
                    self.packing = friction.after_rest(self.constants.settings, self.packing, left_s)
                if self.feedback is not None:
                    self.feedback = after_rest(self._sensor, self.feedback, left_s)
                self.time_s += left_s
                return
            segment = self._segment(force, left_s)
            stem = self.stem
            self.stem = replace(
                stem,
                position_m=segment.position_m,
                velocity_m_per_s=segment.velocity_m_per_s,
                travel_m=stem.travel_m + abs(segment.position_m - stem.position_m),
            )
            if self.feedback is not None:
                sensor, end_m, seconds = self._sensor, segment.position_m, segment.duration_s
                self.feedback = after_motion(sensor, self.feedback, segment.path, end_m, seconds)
            self.time_s += segment.duration_s
            if segment.ending is Ending.BORDER:
                self._reach_border()
            elif segment.ending is Ending.BALANCE:
                self._stop()
            if segment.duration_s >= left_s:
                return
            left_s -= segment.duration_s
            force = force.after(segment.duration_s)

    @property
    def _sensor(self) -> SensorSettings:
        return self.constants.settings.sensor

    @property
    def _preload_n(self) -> float:
        return self.constants.preload_n + self.packing.one_way_n

    def _is_held(self, stem: Stem, force: PushingForce, left_s: float) -> bool:
        """Return whether `force` surely leaves this stem at rest for `left_s`; most steps end here."""
        static_n = self.packing.static_n
        balance_n = self._preload_n + self.constants.spring_n_per_m * stem.position_m
        low_n, high_n = force.range_n(left_s)
        return -static_n <= low_n - balance_n and high_n - balance_n <= static_n

    def _segment(self, force: PushingForce, left_s: float) -> Segment:
        """Return the next motion segment; its kind depends on the speed and on the pull."""
        stem = self.stem
        if stem.is_at_rest:
            return self._rest(force, left_s)
        pull = pull_n(self.constants, stem, self.packing, force.at(0.0))
        if self._is_balanced(pull):
            return Segment(0.0, stem.position_m, 0.0, Ending.BALANCE, Uniform(stem.position_m, 0.0))
        if abs(stem.velocity_m_per_s) > self.constants.band_m_per_s:
            return self._slide(force, left_s)
        return self._start(force, left_s, pull)

    def _is_balanced(self, pull: float) -> bool:
        """Return whether static friction holds the stem, or nothing moves a frictionless one any more."""
        speed, constants = abs(self.stem.velocity_m_per_s), self.constants
        enough_n = max(self.packing.static_n, FORCE_MARGIN_N)
        return abs(pull) <= enough_n and speed <= (constants.band_m_per_s if constants.sticks else _SETTLED_M_PER_S)

    def _rest(self, force: PushingForce, left_s: float) -> Segment:
        """Return the rest until the pressure overcomes static friction; the travel stops hold any force."""
        valve, position_m = self.constants.settings.valve, self.stem.position_m
        balance_n = self._preload_n + self.constants.spring_n_per_m * position_m
        hold_n = max(self.packing.static_n, FORCE_MARGIN_N) + FORCE_MARGIN_N
        # a pull that falls to the limit may be located a little above it, and must not start the stem again
        tolerance_n = located_n(force.slope(0.0))
        up_n, down_n = balance_n + hold_n + max(0.0, -tolerance_n), balance_n - hold_n - max(0.0, tolerance_n)
        if not force.is_simple or self.constants.ages:
            either_n = located_n(force.slope_bound(0.0))
            up_n, down_n = balance_n + hold_n + either_n, balance_n - hold_n - either_n
        opens, closes = position_m < valve.travel_max_m, position_m > valve.travel_min_m
        up_n, down_n = up_n if opens else math.inf, down_n if closes else -math.inf
        along, slip_s = self._slip(force, up_n, down_n, left_s)
        if self.constants.ages:
            self.packing = friction.after_rest(self.constants.settings, self.packing, slip_s)
        path = Uniform(position_m, 0.0)
        if along == 0:
            return Segment(slip_s, position_m, 0.0, Ending.OPEN, path)
        self.stem = replace(self.stem, slips=self.stem.slips + self.constants.sticks)
        self._turn(along)
        return Segment(slip_s, position_m, 0.0, Ending.OPEN, path)

    def _slip(self, force: PushingForce, up_n: float, down_n: float, left_s: float) -> tuple[int, float]:
        """Return +1 or -1 and the time in s at which `force` rises above `up_n` or falls below `down_n`.

        If it does neither before `left_s`: 0, and a time up to which it does not. Both bounds move apart while static
        friction grows.
        """
        if self.constants.ages:
            return _first_slip(force, up_n, down_n, self._ageing(), left_s)
        if not force.is_simple:
            return _first_slip(force, up_n, down_n, None, left_s)
        up_s, down_s = force.time_above(up_n), force.time_below(down_n)
        if min(up_s, down_s) >= left_s:
            return 0, left_s
        return (1, up_s) if up_s < down_s else (-1, down_s)

    def _ageing(self) -> Ageing:
        settings, packing = self.constants.settings.packing, self.packing
        return Ageing(settings, packing.static_n / (1.0 + growth(settings, packing.rested_s)), packing.rested_s)

    def _start(self, force: PushingForce, left_s: float, pull: float) -> Segment:
        """Return the segment inside the zero-speed band, or from its edge, of a stem that `pull` sets in motion."""
        constants, valve = self.constants, self.constants.settings.valve
        band, along = constants.band_m_per_s, 1 if pull > 0.0 else -1
        if self.stem.velocity_m_per_s == 0.0:
            self._turn(along)
        stem, border_m = self.stem, self._border_m()
        if abs(stem.velocity_m_per_s) < band or along != stem.direction:
            return break_away(constants, stem, self.packing, force, left_s, border_m, direction=along)
        self.packing = packing = after_leaving(constants.settings, self.packing)
        edge_n = sliding_n(valve, packing, band)
        quickest_n_per_s = force.slope_bound(0.0) + constants.spring_n_per_m * band
        margin_n = max(FORCE_MARGIN_N, 2.0 * located_n(quickest_n_per_s))
        if not constants.sticks or abs(pull) > edge_n + 0.5 * margin_n:
            return self._slide(force, left_s)
        return creep(constants, stem, packing, force, left_s, border_m, direction=along, limit_n=edge_n + margin_n)

    def _slide(self, force: PushingForce, left_s: float) -> Segment:
        constants, stem, packing, border_m = self.constants, self.stem, self.packing, self._border_m()
        flat, band = constants.flat_m_per_s, constants.band_m_per_s
        if abs(stem.velocity_m_per_s) > flat or flat == band:
            return coast(constants, stem, packing, force, left_s, border_m)
        valve = constants.settings.valve
        slide = StribeckSlide(
            force=force,
            sign=stem.direction,
            mass_kg=valve.mass_kg,
            spring_n_per_m=constants.spring_n_per_m,
            viscous_n_s_per_m=valve.viscous_friction_n_s_per_m,
            load_n=self._preload_n + stem.direction * packing.coulomb_n,
            drop_n=packing.static_n - packing.coulomb_n,
            stribeck_velocity_m_per_s=valve.stribeck_velocity_m_per_s,
        )
        return slide.run(stem.position_m, stem.velocity_m_per_s, left_s, band, constants.flat_again_m_per_s, border_m)

    def _border_m(self) -> float:
        """Return the next border in the direction of motion: a travel stop, or the end of a friction cell."""
        valve = self.constants.settings.valve
        opening = self.stem.direction > 0
        stop_m = valve.travel_max_m if opening else valve.travel_min_m
        if not self.constants.varies_by_place:
            return stop_m
        cell_m = (self.packing.cell + opening) * CELL_WIDTH_M
        return min(stop_m, cell_m) if opening else max(stop_m, cell_m)

    def _reach_border(self) -> None:
        valve = self.constants.settings.valve
        if self.stem.position_m in (valve.travel_min_m, valve.travel_max_m):
            self._stop()
        else:
            self.packing = after_crossing(self.constants.settings, self.packing, self.stem.direction)

    def _stop(self) -> None:
        stops = self.stem.stops + self.constants.sticks
        self.stem = replace(self.stem, direction=0, velocity_m_per_s=0.0, stops=stops)
        self.packing = after_stop(self.constants.settings, self.packing, stops, self.time_s)

    def _turn(self, direction: int) -> None:
        reversals = self.stem.reversals + (self.stem.last_direction == -direction)
        self.stem = replace(self.stem, direction=direction, last_direction=direction, reversals=reversals)


def _first_slip(
    force: PushingForce, up_n: float, down_n: float, ageing: Ageing | None, left_s: float
) -> tuple[int, float]:
    """Return the direction and the time of the first slip, as `_slip`, under any force."""

    def gaps(t: float) -> tuple[float, float]:
        force_n, more_n = force.at(t), 0.0 if ageing is None else ageing.more_n(t)
        return up_n + more_n - force_n, force_n - down_n + more_n

    def clear(t: float) -> float:
        (up_gap, down_gap), slope, bend, growing = gaps(t), force.slope(t), force.bend_bound(t), 0.0
        if ageing is not None:
            growing, bend = ageing.slope(t), bend + ageing.bend_bound(t)
        return min(clear_time(up_gap, growing - slope, bend), clear_time(down_gap, growing + slope, bend))

    up_gap, down_gap = gaps(0.0)
    if min(up_gap, down_gap) < 0.0:
        return (1 if up_gap < 0.0 else -1), 0.0
    slip_s, slips = first_event(clear, left_s)
    if not slips:
        return 0, slip_s
    up_gap, down_gap = gaps(slip_s)
    return (1 if up_gap < down_gap else -1), slip_s
