"""Position sensor: seeded Gaussian noise, white or held, then quantisation. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from plant_emulator.draws import Stream, normal
from positioner.values import dataclass

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings

_HOLD_SLACK = 1e-9
"""Of a hold: an instant this little before its end belongs to the next hold, however it was rounded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """Seed of the noise, and how many samples were taken."""

    seed: int
    samples: int = 0


def measure(settings: PlantSettings, sensor: Sensor, position_m: float, time_s: float) -> tuple[Sensor, float]:
    """Return the sensor after this sample, and the measured position in m of a stem at `position_m` at `time_s`."""
    noise = settings.sensor
    deviation_m = math.hypot(noise.noise_of_reading * position_m, noise.noise_of_span * settings.valve.span_m)
    measured_m = position_m + noise.zero_m
    if deviation_m > 0.0:
        hold_s = noise.noise_hold_s
        index = math.floor(time_s / hold_s + _HOLD_SLACK) if hold_s > 0.0 else sensor.samples
        measured_m += deviation_m * normal(sensor.seed, Stream.SENSOR_NOISE, index)
    if noise.resolution_m > 0.0:
        measured_m = round(measured_m / noise.resolution_m) * noise.resolution_m
    return Sensor(seed=sensor.seed, samples=sensor.samples + 1), measured_m


def pressure_pa(settings: PlantSettings, sensor: Sensor, true_pa: float) -> float:
    """Return the measured pressure in Pa, in the sample that `measure` took last."""
    fraction = settings.sensor.pressure_noise
    if fraction == 0.0:
        return true_pa
    return true_pa * (1.0 + fraction * normal(sensor.seed, Stream.PRESSURE_NOISE, sensor.samples))
