"""Position sensor: seeded noise, Gaussian or uniform, white, held or correlated, then quantisation. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from plant_emulator.draws import Stream, normal, uniform
from plant_emulator.sensor_settings import NoiseShape
from positioner.values import dataclass

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings
    from plant_emulator.sensor_settings import SensorSettings

_UNIFORM = math.sqrt(3.0)
"""Half the width of a uniform distribution with a standard deviation of 1."""
_HOLD_SLACK = 1e-9
"""Of a hold: an instant this little before its end belongs to the next hold, however it was rounded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """Seed of the noise, how many samples were taken, and the last value of correlated noise with its instant in s."""

    seed: int
    samples: int = 0
    correlated: float = 0.0
    correlated_s: float = 0.0


def measure(settings: PlantSettings, sensor: Sensor, position_m: float, time_s: float) -> tuple[Sensor, float]:
    """Return the sensor after this sample, and the measured position in m of a stem at `position_m` at `time_s`."""
    noise = settings.sensor
    deviation_m = math.hypot(noise.noise_of_reading * position_m, noise.noise_of_span * settings.valve.span_m)
    measured_m, value = position_m + noise.zero_m, sensor.correlated
    if deviation_m > 0.0:
        value = _value(noise, sensor, time_s)
        measured_m += deviation_m * value
    if noise.resolution_m > 0.0:
        measured_m = round(measured_m / noise.resolution_m) * noise.resolution_m
    after = Sensor(seed=sensor.seed, samples=sensor.samples + 1, correlated=value, correlated_s=time_s)
    return after, measured_m


def _value(noise: SensorSettings, sensor: Sensor, time_s: float) -> float:
    """Return the noise of this sample, with a standard deviation of 1."""
    hold_s, lag_s = noise.noise_hold_s, noise.noise_correlation_s
    index = math.floor(time_s / hold_s + _HOLD_SLACK) if hold_s > 0.0 else sensor.samples
    if noise.noise_shape is NoiseShape.UNIFORM:
        drawn = _UNIFORM * uniform(sensor.seed, Stream.SENSOR_NOISE, index)
    else:
        drawn = normal(sensor.seed, Stream.SENSOR_NOISE, index)
    if lag_s == 0.0 or sensor.samples == 0:
        return drawn
    kept = math.exp((sensor.correlated_s - time_s) / lag_s)
    return kept * sensor.correlated + math.sqrt(1.0 - kept * kept) * drawn


def pressure_pa(settings: PlantSettings, sensor: Sensor, true_pa: float) -> float:
    """Return the measured pressure in Pa, in the sample that `measure` took last."""
    fraction = settings.sensor.pressure_noise
    if fraction == 0.0:
        return true_pa
    return true_pa * (1.0 + fraction * normal(sensor.seed, Stream.PRESSURE_NOISE, sensor.samples))
