"""One emulated valve: settings, state, current and duration in, next state out. Pure.

With Karnopp's friction, the default, the result does not depend on how a duration is divided into steps: between two
events the motion is exact, and every event is located. The other models take short steps of their own (`contact`).
Plant time is part of the state.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from plant_emulator import lugre, mass_flow, maxwell_slip, own_physics, sensor
from plant_emulator.actuator import Actuator, DelayLine, driven, held_actuator, initial_actuator
from plant_emulator.constants import constants_of
from plant_emulator.contact import Contact, ContactStem
from plant_emulator.converter import Converted
from plant_emulator.feedback import Feedback, is_direct
from plant_emulator.friction import Packing, initial_packing, repacked
from plant_emulator.friction_settings import FrictionModel
from plant_emulator.lugre import LuGreStem
from plant_emulator.maxwell_slip import MaxwellSlipStem
from plant_emulator.moving_stem import MovingStem
from plant_emulator.own_stem import following
from plant_emulator.parameters import ActuatorModel
from plant_emulator.process import disturbed, initial_noise_n
from plant_emulator.schedule import acting, every_settings, stretches
from plant_emulator.stem import Stem
from plant_emulator.stem import friction_n as friction_on_stem_n
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from plant_emulator.own_physics import Running
    from plant_emulator.parameters import PlantSettings
    from plant_emulator.sensor import Sensor


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantState:
    """A valve at one instant, part by part."""

    time_s: float
    stem: Stem
    packing: Packing
    actuator: Actuator
    sensor: Sensor
    disturbance_n: float = 0.0
    """The noise of the process force."""
    feedback: Feedback | None = None
    """None where the sensor shows the stem as it is."""
    own: Running | None = None
    """The plant of a plug-in that has its own physics; pressures and friction are then unknown, NaN."""
    contact: Contact | None = None
    """None in Karnopp's model, whose contact is rigid."""


def initial_state(settings: PlantSettings, seed: int) -> PlantState:
    """Return a valve at rest at its initial position, with the pressure that balances its spring there."""
    valve, position_m = settings.valve, settings.valve.initial_position_m
    constants = constants_of(settings)
    push_n = constants.preload_n + constants.spring_n_per_m * position_m
    if settings.physics is not None:
        balance_ma = push_n / (valve.diaphragm_area_m2 * valve.pressure_gain_pa_per_ma)
        return _own_initial(settings, settings.physics, seed, balance_ma)
    is_direct_always = all(is_direct(each.sensor) for each in every_settings(settings))
    elements = 0
    if settings.friction.model is not FrictionModel.KARNOPP:
        elements = 1 if settings.friction.model is FrictionModel.LUGRE else len(settings.friction.element_forces)
    return PlantState(
        time_s=0.0,
        stem=Stem(position_m=position_m),
        packing=initial_packing(settings, seed),
        actuator=initial_actuator(settings, push_n / valve.diaphragm_area_m2),
        sensor=sensor.Sensor(seed=seed),
        disturbance_n=initial_noise_n(settings.process, seed),
        feedback=None if is_direct_always else Feedback(position_m, position_m),
        contact=Contact((0.0,) * elements, (0,) * elements) if elements else None,
    )


def held_state(settings: PlantSettings, seed: int, current_ma: float) -> PlantState:
    """Return a valve that is held at its initial position, with the pressure that belongs to `current_ma`."""
    if settings.physics is not None:  # its stem goes where its physics lets it
        return _own_initial(settings, settings.physics, seed, current_ma)
    return replace(initial_state(settings, seed), actuator=held_actuator(settings, current_ma))


def step(settings: PlantSettings, state: PlantState, current_ma: float, duration_s: float) -> PlantState:
    """Return the valve `duration_s` later, its loop current held at `current_ma` meanwhile."""
    if state.own is not None:
        return _own_step(settings, state, state.own, current_ma, duration_s)
    if settings.schedule:
        return _scheduled(settings, state, current_ma, duration_s)
    moving, disturbance_n = moved(settings, state), state.disturbance_n
    if settings.actuator.model is ActuatorModel.MASS_FLOW:
        actuator, disturbance_n = mass_flow.advance(
            settings, state.actuator, current_ma, moving, state.sensor.seed, disturbance_n, duration_s
        )
    else:
        actuator, forces = driven(settings, state.actuator, current_ma, state.time_s, duration_s)
        if settings.process.is_disturbed:
            disturbance_n, forces = disturbed(settings.process, state.sensor.seed, disturbance_n, state.time_s, forces)
        for force, stretch_s in forces:
            moving.advance(force, stretch_s)
    return PlantState(
        time_s=state.time_s + duration_s,
        stem=moving.stem,
        packing=moving.packing,
        actuator=actuator,
        sensor=state.sensor,
        disturbance_n=disturbance_n,
        feedback=moving.feedback,
        contact=moving.contact() if isinstance(moving, ContactStem) else None,
    )


def moved(settings: PlantSettings, state: PlantState) -> MovingStem | ContactStem:
    """Return the stem of `state`, to be moved by the friction model of `settings`."""
    constants, contact = constants_of(settings), state.contact
    if contact is None:
        return MovingStem(constants, state.stem, state.packing, state.time_s, state.feedback)
    if settings.friction.model is FrictionModel.LUGRE:
        return LuGreStem(constants, state.stem, state.packing, state.time_s, state.feedback, contact)
    return MaxwellSlipStem(constants, state.stem, state.packing, state.time_s, state.feedback, contact)


def _scheduled(settings: PlantSettings, state: PlantState, current_ma: float, duration_s: float) -> PlantState:
    for each in stretches(settings, state.time_s, duration_s):
        if each.before is not None:
            packing = repacked(each.before, each.settings, state.packing, state.stem.stops, state.time_s)
            state = replace(state, packing=packing)
        state = step(each.settings, state, current_ma, each.duration_s)
    return state


def measure(settings: PlantSettings, state: PlantState) -> tuple[PlantState, float]:
    """Return the valve after its sensor took a sample, and the measured position in m."""
    if settings.schedule:
        settings = acting(settings, state.time_s)
    shown_m = state.stem.position_m if state.feedback is None else state.feedback.shown_m
    if state.own is not None:
        shown_m = own_physics.reading_m(state.own)
    measured, position_m = sensor.measure(settings, state.sensor, shown_m, state.time_s)
    after = PlantState(
        time_s=state.time_s,
        stem=state.stem,
        packing=state.packing,
        actuator=state.actuator,
        sensor=measured,
        disturbance_n=state.disturbance_n,
        feedback=state.feedback,
        own=state.own,
        contact=state.contact,
    )
    return after, position_m


def friction_n(settings: PlantSettings, state: PlantState) -> float:
    """Return the friction on the stem in N, positive against opening motion.

    In Karnopp's model, that of a stem at rest is the pull, at most F_s.
    """
    if state.own is not None:
        return math.nan
    settings = acting(settings, state.time_s)
    if state.contact is not None:
        constants = constants_of(settings)
        if settings.friction.model is FrictionModel.LUGRE:
            return lugre.friction_n(constants, state.stem, state.packing, state.contact)
        return maxwell_slip.friction_n(constants, state.stem, state.packing, state.contact)
    push_n = state.actuator.pressure_pa * settings.valve.diaphragm_area_m2 - state.disturbance_n
    return friction_on_stem_n(constants_of(settings), state.stem, state.packing, push_n)


def _own_initial(settings: PlantSettings, physics: str, seed: int, current_ma: float) -> PlantState:
    own = own_physics.begun(physics, seed)
    position_m, velocity_m_per_s = own_physics.truth_of(own)
    return PlantState(
        time_s=0.0,
        stem=following(
            Stem(position_m=position_m), position_m, velocity_m_per_s, settings.valve.stick_velocity_m_per_s
        ),
        packing=initial_packing(settings, seed),
        actuator=_own_actuator(current_ma),
        sensor=sensor.Sensor(seed=seed),
        own=own,
    )


def _own_step(
    settings: PlantSettings, state: PlantState, own: Running, current_ma: float, duration_s: float
) -> PlantState:
    if duration_s <= 0.0:
        return state
    own = own_physics.advanced(own, current_ma, duration_s)
    position_m, velocity_m_per_s = own_physics.truth_of(own)
    return PlantState(
        time_s=state.time_s + duration_s,
        stem=following(state.stem, position_m, velocity_m_per_s, settings.valve.stick_velocity_m_per_s),
        packing=state.packing,
        actuator=_own_actuator(current_ma),
        sensor=state.sensor,
        own=own,
    )


def _own_actuator(current_ma: float) -> Actuator:
    """Return an actuator whose pressures nobody knows."""
    passed = Converted(current_ma, current_ma)
    return Actuator(pressure_pa=math.nan, converter_pa=math.nan, converted=passed, line=DelayLine(current_ma))
