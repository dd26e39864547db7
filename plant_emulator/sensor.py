"""Position sensor: seeded Gaussian noise, white or held, then quantisation. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from plant_emulator.draws import Stream, normal

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings

_HOLD_SLACK = 1e-9
"""Of a hold: times on its border, a rounding error early, already belong to the next hold."""


@dataclass(frozen=True, slots=True)
class SensorState:
    """Seed of the noise, and how many samples were taken."""

    seed: int
    samples: int = 0


def initial_state(seed: int) -> SensorState:
    """Return the state of a sensor that has not measured yet."""
    return SensorState(seed)


def measure(settings: PlantSettings, state: SensorState, position_m: float, time_s: float) -> tuple[SensorState, float]:
    """Return the next sensor state, and the measured position in m of a stem at `position_m` at `time_s`."""
    sensor = settings.sensor
    deviation_m = math.hypot(sensor.noise_of_reading * position_m, sensor.noise_of_span * settings.valve.span_m)
    measured_m = position_m
    if deviation_m > 0.0:
        hold_s = sensor.noise_hold_s
        index = math.floor(time_s / hold_s + _HOLD_SLACK) if hold_s > 0.0 else state.samples
        measured_m += deviation_m * normal(state.seed, Stream.SENSOR_NOISE, index)
    if sensor.resolution_m > 0.0:
        measured_m = round(measured_m / sensor.resolution_m) * sensor.resolution_m
    return SensorState(state.seed, state.samples + 1), measured_m
