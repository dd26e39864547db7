"""A chamber that fills and vents through orifices, choked and not, and grows with the stem. Pure.

    G = s·C·p_1·ω(p_2/p_1),   ω(r) = 1 for r <= b, else √(1 - ((r - b)/(1 - b))²)
    (p·Vⁿ)' = n·V^(n-1)·p_0·G,   V = V_0 + S_a·(x - x_min)

G is the volume flow at the reference state of ISO 8778 (p_0 = 100 kPa, 20 °C) through an orifice of the sonic
conductance C and the critical pressure ratio b, from the pressure p_1 to p_2: ISO 6358-1:2013, with the linear flow
above r = 0.999 that keeps its slope finite. All pressures are absolute; the air before an orifice has 20 °C. n is 1 in
an isothermal chamber, where the second equation is the balance of mass, and 1.4 in an adiabatic one.

The I/P converter is a spool. It opens in proportion to the difference of the commanded pressure from that in the
chamber, s = (w - p)/Δp within ±1: towards the supply, or towards the atmosphere.

A double-acting actuator has a second chamber, V_2 = V_02 + S_a·(x_max - x), whose pressure pushes against the first.
For a net pressure w the converter wants (p_s + w)/2 in the first and (p_s - w)/2 in the second, with a spool for each.

Time passes in short steps. In each, the stem moves under a ramp of pressure that is extrapolated from its velocity;
then the volume at which it has arrived gives the pressure, without a loss of mass. A step is h = 0.15/ω_g, at
most 0.25 ms, where ω_g = √((n·p·S_a²/V + K)/m) is the frequency of the stem on the air and its spring.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from plant_emulator import converter
from plant_emulator.actuator import Actuator, commanded, opposing_target_pa
from plant_emulator.force import PushingForce
from plant_emulator.process import disturbed

if TYPE_CHECKING:
    from plant_emulator.chamber_settings import ChamberSettings
    from plant_emulator.contact import ContactStem
    from plant_emulator.moving_stem import MovingStem
    from plant_emulator.parameters import PlantSettings

REFERENCE_PA = 100e3
"""p_0 of ISO 8778."""
ATMOSPHERE_PA = 101325.0
"""Pressures of a plant are above this one."""
_LINEAR = 0.999
"""Ratio of the pressures above which the flow is linear."""
_STEP = 0.15
"""Of the time constant of the stem on the air."""
_LONGEST_S = 2.5e-4
_SETTLED_PA = 1e-6


def flow_function(ratio: float, critical: float) -> float:
    """Return ω, the flow as a part of the choked one, at this ratio of the pressures behind and before an orifice."""
    if ratio <= critical:
        return 1.0
    if ratio >= 1.0:
        return 0.0
    if ratio > _LINEAR:
        return flow_function(_LINEAR, critical) * (1.0 - ratio) / (1.0 - _LINEAR)
    part = (ratio - critical) / (1.0 - critical)
    return math.sqrt(1.0 - part * part)


def flow_m3_per_s(chamber: ChamberSettings, supply_pa: float, pressure_pa: float, commanded_pa: float) -> float:
    """Return G into the chamber at `pressure_pa`; all three pressures are above the atmosphere."""
    opening = (commanded_pa - pressure_pa) / chamber.opening_pa
    absolute_pa, source_pa = pressure_pa + ATMOSPHERE_PA, supply_pa + ATMOSPHERE_PA
    if opening >= 0.0:
        flow = chamber.fill_conductance_m3_per_s_pa * source_pa
        return min(opening, 1.0) * flow * flow_function(absolute_pa / source_pa, chamber.critical_pressure_ratio)
    flow = chamber.vent_conductance_m3_per_s_pa * absolute_pa
    return max(opening, -1.0) * flow * flow_function(ATMOSPHERE_PA / absolute_pa, chamber.critical_pressure_ratio)


def advance(
    settings: PlantSettings,
    actuator: Actuator,
    current_ma: float,
    moving: MovingStem | ContactStem,
    seed: int,
    disturbance_n: float,
    duration_s: float,
) -> tuple[Actuator, float]:
    """Move `moving` for `duration_s` under `current_ma`; return the actuator and the noise of the process after it.

    seed, disturbance_n: of the noise of the process force.
    """
    line, stretches = commanded(actuator.line, settings.actuator.dead_time_s, current_ma, moving.time_s, duration_s)
    converted, chamber = actuator.converted, _Chamber(settings, actuator, moving, seed, disturbance_n)
    for acting_ma, stretch_s in stretches:
        converted = converter.converted(settings.actuator, converted, acting_ma)
        chamber.advance(converter.pressure_pa(settings, converted.passed_ma), stretch_s)
    after = Actuator(
        pressure_pa=chamber.net_pa,
        converter_pa=chamber.converter_pa,
        converted=converted,
        line=line,
        opposing_pa=chamber.opposing_pa,
    )
    return after, chamber.disturbance_n


class _Chamber:
    """The chamber, an opposing one if there is, and the stem that they move, while one step is computed; mutable."""

    def __init__(
        self,
        settings: PlantSettings,
        actuator: Actuator,
        moving: MovingStem | ContactStem,
        seed: int,
        disturbance_n: float,
    ) -> None:
        self.settings = settings
        self.moving = moving
        self.seed = seed
        self.disturbance_n: float = disturbance_n
        self.opposing_pa: float = actuator.opposing_pa
        self.pressure_pa: float = actuator.pressure_pa + actuator.opposing_pa
        self.converter_pa: float = actuator.converter_pa
        self.area_m2: float = settings.valve.diaphragm_area_m2
        self.is_double: bool = settings.chamber.double_acting

    @property
    def net_pa(self) -> float:
        """The pressure that pushes the stem."""
        return self.pressure_pa - self.opposing_pa

    def advance(self, target_pa: float, duration_s: float) -> None:
        """Let `duration_s` pass while the converter's input belongs to `target_pa`."""
        lag_s: float = self.settings.actuator.converter_time_constant_s
        left_s: float = duration_s
        rested = False
        while left_s > 0.0:
            if rested and self._is_settled(target_pa):
                self._push(PushingForce(self.area_m2 * self.net_pa), left_s)
                return
            longest_s = self._longest_s()
            # equal steps to the end, so that none is tiny
            step_s = left_s / math.ceil(left_s / longest_s)
            middle_pa = end_pa = target_pa
            if lag_s > 0.0:
                apart_pa = self.converter_pa - target_pa
                middle_pa += apart_pa * math.exp(-0.5 * step_s / lag_s)
                end_pa += apart_pa * math.exp(-step_s / lag_s)
            before = self.moving.stem
            self._step(middle_pa, step_s)
            rested = self.moving.stem is before
            self.converter_pa = end_pa
            left_s = 0.0 if step_s >= left_s else left_s - step_s

    def _is_settled(self, target_pa: float) -> bool:
        """Return whether the pressures do not change any more, under a stem that the last step left at rest."""
        near_pa = abs(self.net_pa - target_pa) + abs(self.converter_pa - target_pa)
        near_pa += abs(self.opposing_pa - opposing_target_pa(self.settings, target_pa))
        return near_pa < _SETTLED_PA and not self.settings.process.is_disturbed

    def _volume_m3(self, position_m: float) -> float:
        return self.settings.chamber.dead_volume_m3 + self.area_m2 * (position_m - self.settings.valve.travel_min_m)

    def _opposing_m3(self, position_m: float) -> float:
        chamber, valve = self.settings.chamber, self.settings.valve
        return chamber.opposing_dead_volume_m3 + self.area_m2 * (valve.travel_max_m - position_m)

    def _longest_s(self) -> float:
        settings, position_m = self.settings, self.moving.stem.position_m
        stiffness = (self.pressure_pa + ATMOSPHERE_PA) / self._volume_m3(position_m)
        if self.is_double:
            stiffness += (self.opposing_pa + ATMOSPHERE_PA) / self._opposing_m3(position_m)
        air = settings.chamber.polytropic_index * stiffness * self.area_m2 * self.area_m2
        return min(_STEP * math.sqrt(settings.valve.mass_kg / (air + settings.valve.spring_rate_n_per_m)), _LONGEST_S)

    def _step(self, commanded_pa: float, step_s: float) -> None:
        """Move the stem under a ramp of pressure, and balance the air with the volumes at its end."""
        valve, stem = self.settings.valve, self.moving.stem
        before_m: float = stem.position_m
        expected_m = min(max(before_m + stem.velocity_m_per_s * step_s, valve.travel_min_m), valve.travel_max_m)
        middle_m = 0.5 * (before_m + expected_m)
        opposing_target = opposing_target_pa(self.settings, commanded_pa)
        let_in = self._let_in(self.pressure_pa, commanded_pa + opposing_target, self._volume_m3(middle_m), step_s)
        expected_pa, opposing_in = self._balanced_pa(before_m, expected_m, let_in), 0.0
        if self.is_double:
            opposing_in = self._let_in(self.opposing_pa, opposing_target, self._opposing_m3(middle_m), step_s)
            expected_pa -= self._opposing_balanced_pa(before_m, expected_m, opposing_in)
        slope = (expected_pa - self.net_pa) / step_s
        self._push(PushingForce(self.area_m2 * self.net_pa, (), self.area_m2 * slope), step_s)
        after_m: float = self.moving.stem.position_m
        self.pressure_pa = self._balanced_pa(before_m, after_m, let_in)
        if self.is_double:
            self.opposing_pa = self._opposing_balanced_pa(before_m, after_m, opposing_in)

    def _balanced_pa(self, before_m: float, after_m: float, let_in: float) -> float:
        index = self.settings.chamber.polytropic_index
        return _balanced_pa(self.pressure_pa, self._volume_m3(before_m), self._volume_m3(after_m), let_in, index)

    def _opposing_balanced_pa(self, before_m: float, after_m: float, let_in: float) -> float:
        index = self.settings.chamber.polytropic_index
        return _balanced_pa(self.opposing_pa, self._opposing_m3(before_m), self._opposing_m3(after_m), let_in, index)

    def _let_in(self, pressure_pa: float, commanded_pa: float, volume_m3: float, step_s: float) -> float:
        """Return p_0·∫G dt in Pa·m³: an exponential step with the slope of the flow over the pressure."""
        chamber, supply_pa = self.settings.chamber, self.settings.actuator.supply_pa
        flow = flow_m3_per_s(chamber, supply_pa, pressure_pa, commanded_pa)
        probe_pa = 1e-3 * (1.0 + abs(commanded_pa - pressure_pa))
        probe_pa = probe_pa if commanded_pa >= pressure_pa else -probe_pa
        slope = (flow_m3_per_s(chamber, supply_pa, pressure_pa + probe_pa, commanded_pa) - flow) / probe_pa
        fading = slope * REFERENCE_PA * chamber.polytropic_index / volume_m3 * step_s
        mean = math.expm1(fading) / fading if abs(fading) > 1e-9 else 1.0  # noqa: PLR2004 - the limit is 1
        return REFERENCE_PA * flow * mean * step_s

    def _push(self, force: PushingForce, seconds: float) -> None:
        process = self.settings.process
        forces: tuple[tuple[PushingForce, float], ...] = ((force, seconds),)
        if process.is_disturbed:
            self.disturbance_n, forces = disturbed(process, self.seed, self.disturbance_n, self.moving.time_s, forces)
        for each, stretch_s in forces:
            self.moving.advance(each, stretch_s)


def _balanced_pa(pressure_pa: float, before_m3: float, after_m3: float, let_in: float, index: float) -> float:
    """Return the pressure after the volume changed while `let_in` Pa·m³ of air came in."""
    absolute_pa = pressure_pa + ATMOSPHERE_PA
    if index == 1.0:
        return (absolute_pa * before_m3 + let_in) / after_m3 - ATMOSPHERE_PA
    middle_m3 = 0.5 * (before_m3 + after_m3)
    held = absolute_pa * math.pow(before_m3, index) + index * math.pow(middle_m3, index - 1.0) * let_in
    return held / math.pow(after_m3, index) - ATMOSPHERE_PA
