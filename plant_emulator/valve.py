"""One emulated valve: settings, state, current and duration in, next state out. Pure.

The result does not depend on how a duration is divided into steps: between two events the motion is exact, and every
event is located. Plant time is part of the state.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from plant_emulator import sensor
from plant_emulator.actuator import Actuator, driven, held_actuator, initial_actuator
from plant_emulator.constants import constants_of
from plant_emulator.feedback import Feedback, is_direct
from plant_emulator.friction import Packing, initial_packing, repacked
from plant_emulator.moving_stem import MovingStem
from plant_emulator.process import disturbed, initial_noise_n
from plant_emulator.schedule import acting, every_settings, stretches
from plant_emulator.stem import Stem
from plant_emulator.stem import friction_n as friction_on_stem_n
from positioner.values import dataclass, replace

if TYPE_CHECKING:
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


def initial_state(settings: PlantSettings, seed: int) -> PlantState:
    """Return a valve at rest at its initial position, with the pressure that balances its spring there."""
    valve, position_m = settings.valve, settings.valve.initial_position_m
    constants = constants_of(settings)
    is_direct_always = all(is_direct(each.sensor) for each in every_settings(settings))
    push_n = constants.preload_n + constants.spring_n_per_m * position_m
    return PlantState(
        time_s=0.0,
        stem=Stem(position_m=position_m),
        packing=initial_packing(settings, seed),
        actuator=initial_actuator(settings, push_n / valve.diaphragm_area_m2),
        sensor=sensor.Sensor(seed=seed),
        disturbance_n=initial_noise_n(settings.process, seed),
        feedback=None if is_direct_always else Feedback(position_m, position_m),
    )


def held_state(settings: PlantSettings, seed: int, current_ma: float) -> PlantState:
    """Return a valve that is held at its initial position, with the pressure that belongs to `current_ma`."""
    return replace(initial_state(settings, seed), actuator=held_actuator(settings, current_ma))


def step(settings: PlantSettings, state: PlantState, current_ma: float, duration_s: float) -> PlantState:
    """Return the valve `duration_s` later, its loop current held at `current_ma` meanwhile."""
    if settings.schedule:
        return _scheduled(settings, state, current_ma, duration_s)
    actuator, forces = driven(settings, state.actuator, current_ma, state.time_s, duration_s)
    disturbance_n = state.disturbance_n
    if settings.process.noise_n > 0.0:
        disturbance_n, forces = disturbed(settings.process, state.sensor.seed, disturbance_n, state.time_s, forces)
    moving = MovingStem(constants_of(settings), state.stem, state.packing, state.time_s, state.feedback)
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
    )


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
    measured, position_m = sensor.measure(settings, state.sensor, shown_m, state.time_s)
    after = PlantState(
        time_s=state.time_s,
        stem=state.stem,
        packing=state.packing,
        actuator=state.actuator,
        sensor=measured,
        disturbance_n=state.disturbance_n,
        feedback=state.feedback,
    )
    return after, position_m


def friction_n(settings: PlantSettings, state: PlantState) -> float:
    """Return the friction on the stem in N, positive against opening motion; at rest it is the pull, at most F_s."""
    settings = acting(settings, state.time_s)
    push_n = state.actuator.pressure_pa * settings.valve.diaphragm_area_m2 - state.disturbance_n
    return friction_on_stem_n(constants_of(settings), state.stem, state.packing, push_n)
