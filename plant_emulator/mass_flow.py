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


class _Side:
    """The air on one side of the diaphragm; mutable.

    sign: +1 where its pressure opens the valve, -1 in the opposing chamber. stop_m: where the stem leaves it only its
    dead volume.
    """

    def __init__(self, settings: PlantSettings, sign: float, pressure_pa: float) -> None:
        chamber, valve = settings.chamber, settings.valve
        self.settings = settings
        self.sign: float = sign
        self.pressure_pa: float = pressure_pa
        self.area_m2: float = valve.diaphragm_area_m2
        self.stop_m: float = valve.travel_min_m if sign > 0.0 else valve.travel_max_m
        self.dead_volume_m3: float = chamber.dead_volume_m3 if sign > 0.0 else chamber.opposing_dead_volume_m3

    def volume_m3(self, position_m: float) -> float:
        return self.dead_volume_m3 + self.area_m2 * abs(position_m - self.stop_m)

    def stiffness_pa_per_m3(self, position_m: float) -> float:
        return (self.pressure_pa + ATMOSPHERE_PA) / self.volume_m3(position_m)

    def wanted_pa(self, commanded_pa: float) -> float:
        """Return the pressure that the converter wants here, for a net pressure of `commanded_pa`."""
        opposing_pa = opposing_target_pa(self.settings, commanded_pa)
        return commanded_pa + opposing_pa if self.sign > 0.0 else opposing_pa

    def let_in(self, commanded_pa: float, position_m: float, step_s: float) -> float:
        """Return p_0·∫G dt in Pa·m³: an exponential step with the slope of the flow over the pressure."""
        chamber, supply_pa, pressure_pa = self.settings.chamber, self.settings.actuator.supply_pa, self.pressure_pa
        wanted_pa = self.wanted_pa(commanded_pa)
        flow = flow_m3_per_s(chamber, supply_pa, pressure_pa, wanted_pa)
        probe_pa = 1e-3 * (1.0 + abs(wanted_pa - pressure_pa))
        probe_pa = probe_pa if wanted_pa >= pressure_pa else -probe_pa
        slope = (flow_m3_per_s(chamber, supply_pa, pressure_pa + probe_pa, wanted_pa) - flow) / probe_pa
        fading = slope * REFERENCE_PA * chamber.polytropic_index / self.volume_m3(position_m) * step_s
        mean = math.expm1(fading) / fading if abs(fading) > 1e-9 else 1.0  # noqa: PLR2004 - the limit is 1
        return REFERENCE_PA * flow * mean * step_s

    def balanced_pa(self, before_m: float, after_m: float, let_in: float) -> float:
        """Return the pressure after the stem has moved while `let_in` Pa·m³ of air came in."""
        index = self.settings.chamber.polytropic_index
        return _balanced_pa(self.pressure_pa, self.volume_m3(before_m), self.volume_m3(after_m), let_in, index)


class _Chamber:
    """The air on one side or on both, and the stem that it moves, while one step is computed; mutable."""

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
        self.sides: list[_Side] = [_Side(settings, 1.0, actuator.pressure_pa + actuator.opposing_pa)]
        if settings.chamber.double_acting:
            self.sides.append(_Side(settings, -1.0, actuator.opposing_pa))
        self.converter_pa: float = actuator.converter_pa
        self.area_m2: float = settings.valve.diaphragm_area_m2

    @property
    def net_pa(self) -> float:
        """The pressure that pushes the stem."""
        return sum([side.sign * side.pressure_pa for side in self.sides])

    @property
    def opposing_pa(self) -> float:
        """The pressure of the opposing chamber, 0 where there is none."""
        return self.sides[1].pressure_pa if len(self.sides) > 1 else 0.0

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
        near_pa = abs(self.converter_pa - target_pa)
        for side in self.sides:
            near_pa += abs(side.pressure_pa - side.wanted_pa(target_pa))
        return near_pa < _SETTLED_PA and not self.settings.process.is_disturbed

    def _longest_s(self) -> float:
        settings, position_m = self.settings, self.moving.stem.position_m
        stiffness = sum([side.stiffness_pa_per_m3(position_m) for side in self.sides])
        air = settings.chamber.polytropic_index * stiffness * self.area_m2 * self.area_m2
        return min(_STEP * math.sqrt(settings.valve.mass_kg / (air + settings.valve.spring_rate_n_per_m)), _LONGEST_S)

    def _step(self, commanded_pa: float, step_s: float) -> None:
        """Move the stem under a ramp of pressure, and balance the air with the volumes at its end."""
        valve, stem = self.settings.valve, self.moving.stem
        before_m: float = stem.position_m
        expected_m = min(max(before_m + stem.velocity_m_per_s * step_s, valve.travel_min_m), valve.travel_max_m)
        middle_m = 0.5 * (before_m + expected_m)
        let_in = [side.let_in(commanded_pa, middle_m, step_s) for side in self.sides]
        expected_pa = 0.0
        for side, air in zip(self.sides, let_in, strict=True):
            expected_pa += side.sign * side.balanced_pa(before_m, expected_m, air)
        net_pa = self.net_pa
        slope = (expected_pa - net_pa) / step_s
        self._push(PushingForce(self.area_m2 * net_pa, (), self.area_m2 * slope), step_s)
        after_m: float = self.moving.stem.position_m
        for side, air in zip(self.sides, let_in, strict=True):
            side.pressure_pa = side.balanced_pa(before_m, after_m, air)

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
