"""The sensor: size and spectrum of its noise, its resolution, its seed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from plant_emulator import sensor
from plant_emulator.presets import plant_settings

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings

COUNT = 20_000


def readings(settings: PlantSettings, position_m: float, seed: int = 1, period_s: float = 0.001) -> np.ndarray:
    state, values = sensor.Sensor(seed=seed), []
    for index in range(COUNT):
        state, measured_m = sensor.measure(settings, state, position_m, index * period_s)
        values.append(measured_m)
    return np.array(values)


def test_a_sensor_without_noise_gives_the_true_position() -> None:
    quiet = plant_settings("paper", "sensor.noise_of_reading = 0.0")
    assert (readings(quiet, 0.0712) == 0.0712).all()


@pytest.mark.parametrize(
    ("overrides", "deviation_m"),
    [
        ("", 0.02 * 0.08),
        ("sensor.noise_of_reading = 0.0\nsensor.noise_of_span = 0.0005", 0.0005 * 0.127),
        ("sensor.noise_of_reading = 0.003\nsensor.noise_of_span = 0.004", np.hypot(0.003 * 0.08, 0.004 * 0.127)),
    ],
)
def test_the_noise_is_gaussian_white_and_of_the_stated_size(overrides: str, deviation_m: float) -> None:
    noise = readings(plant_settings("paper", overrides), 0.08) - 0.08
    assert noise.std() == pytest.approx(deviation_m, rel=0.02)  # four sigma of a deviation from 20000
    assert noise.mean() == pytest.approx(0.0, abs=4.0 * deviation_m / np.sqrt(COUNT))
    assert np.mean(np.abs(noise) < deviation_m) == pytest.approx(0.6827, abs=0.014)
    assert np.corrcoef(noise[1:], noise[:-1])[0, 1] == pytest.approx(0.0, abs=4.0 / np.sqrt(COUNT))


def test_held_noise_changes_once_per_hold_and_only_then() -> None:
    noise = readings(plant_settings("paper", "sensor.noise_hold_s = 0.01"), 0.08)
    blocks = noise.reshape(-1, 10)
    assert (blocks == blocks[:, :1]).all()
    assert len(set(blocks[:, 0])) == len(blocks)
    assert (blocks[:, 0] - 0.08).std() == pytest.approx(0.0016, rel=0.07)


def test_held_noise_does_not_depend_on_how_often_it_is_read() -> None:
    settings = plant_settings("paper", "sensor.noise_hold_s = 0.01")
    assert (readings(settings, 0.08)[:1000:10] == readings(settings, 0.08, period_s=0.01)[:100]).all()


def test_quantisation_rounds_to_the_nearest_step() -> None:
    settings = plant_settings("paper", "sensor.noise_of_reading = 0.0\nsensor.resolution_m = 0.0001")
    for position_m, expected_m in ((0.01234, 0.0123), (0.01236, 0.0124), (-0.00004, 0.0)):
        assert sensor.measure(settings, sensor.Sensor(seed=0), position_m, 0.0)[1] == pytest.approx(expected_m)


def test_a_seed_repeats_its_noise_and_another_does_not() -> None:
    settings = plant_settings("paper")
    first, again, other = (readings(settings, 0.08, seed) for seed in (3, 3, 4))
    assert (first == again).all()
    assert np.corrcoef(first, other)[0, 1] == pytest.approx(0.0, abs=4.0 / np.sqrt(COUNT))


def test_a_shifted_zero_is_added_to_the_reading() -> None:
    shifted = plant_settings("paper", "sensor.noise_of_reading = 0.0\nsensor.zero_m = -0.002")
    assert sensor.measure(shifted, sensor.Sensor(seed=0), 0.05, 0.0)[1] == pytest.approx(0.048, rel=1e-14)


def test_the_noise_of_the_pressure_is_white_a_fraction_of_the_reading_and_not_that_of_the_position() -> None:
    settings = plant_settings("paper", "sensor.pressure_noise = 0.01")
    state, pressures = sensor.Sensor(seed=1), []
    for index in range(COUNT):
        state, _ = sensor.measure(settings, state, 0.08, index * 0.001)
        pressures.append(sensor.pressure_pa(settings, state, 5e4) / 5e4 - 1.0)
    noise = np.array(pressures)
    assert noise.std() == pytest.approx(0.01, rel=0.02)
    assert np.corrcoef(noise[1:], noise[:-1])[0, 1] == pytest.approx(0.0, abs=4.0 / np.sqrt(COUNT))
    assert np.corrcoef(noise, readings(settings, 0.08))[0, 1] == pytest.approx(0.0, abs=4.0 / np.sqrt(COUNT))
