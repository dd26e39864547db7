"""The sensor's noise, learned at rest: white, correlated, held, quantised, larger or smaller than configured."""

from __future__ import annotations

import math

import numpy as np
import pytest

from positioner.laws.nmpc.filter import AdaptiveFilter, Resting, as_one_more_m2, average, believed_m
from positioner.laws.nmpc.resolution import Resolution
from positioner.laws.nmpc.sensor_noise import SensorNoise
from positioner.laws.nmpc.settings import AdaptationSettings
from positioner.valve.motion import Load, MotionModel


def after(readings: list[float], *, moves_every: int = 0) -> SensorNoise:
    noise = SensorNoise()
    for index, reading in enumerate(readings):
        if moves_every and index % moves_every == 0:
            noise = noise.at_new_place()
        noise = noise.followed_by(reading)
    return noise


def correlated(count: int, rho: float, seed: int = 1, sigma: float = 1.0) -> list[float]:
    draw = np.random.default_rng(seed)
    values = [float(draw.normal())]
    while len(values) < count:
        values.append(rho * values[-1] + math.sqrt(1.0 - rho * rho) * float(draw.normal()))
    return [50.0 + sigma * each for each in values]


def white(count: int, sigma: float, seed: int = 1) -> list[float]:
    return correlated(count, 0.0, seed, sigma)


@pytest.mark.parametrize("sigma", [0.25, 0.5, 1.0, 2.0])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_white_noise_is_known_to_a_tenth_after_two_thousand_readings(sigma: float, seed: int) -> None:
    found = after(white(2000, sigma, seed))
    # the variance of n readings is known to √(2/n): 3 %
    assert 0.9 * sigma**2 < found.averaged < 1.1 * sigma**2
    assert 0.9 * sigma**2 < found.of_reading < 1.1 * sigma**2


def test_twice_the_configured_noise_is_noticed_within_a_hundred_readings() -> None:
    # half the true noise would be the severe error: the estimate must be above it soon
    assert after(white(100, 2.0)).averaged > 2.0


@pytest.mark.parametrize(("rho", "most"), [(0.5, 1.3), (0.9, 1.5), (0.95, 2.0)])
def test_correlated_noise_counts_as_the_average_scatters(rho: float, most: float) -> None:
    # n times the variance of the mean of n readings: (1 + ρ)/(1 - ρ)
    expected = (1.0 + rho) / (1.0 - rho)
    assert expected / most < after(correlated(4000, rho)).averaged < expected * most


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_noise_with_a_long_memory_is_never_believed_to_be_small(seed: int) -> None:
    # 30 readings of AR(0.99), V = 199, look like a hundredth of the noise
    assert after(correlated(30, 0.99, seed)).averaged > 50.0
    assert after(correlated(2000, 0.99, seed), moves_every=200).averaged > 30.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_law_that_moves_after_every_hundred_readings_learns_the_correlation_too(seed: int) -> None:
    assert 10.0 < after(correlated(3000, 0.9, seed), moves_every=100).averaged < 40.0


@pytest.mark.parametrize("held", [4, 10, 32])
def test_noise_that_is_held_counts_at_least_as_often_as_it_is_held(held: int) -> None:
    readings = np.repeat(white(800, 1.0), held).tolist()
    # for the lag of one reading it looks as if it remembered 1 - 1/held of itself: twice the variance at most
    assert 0.6 * held < after(readings).averaged < 2.5 * held


def test_noise_that_wanders_slowly_below_white_noise_is_seen_by_its_octaves() -> None:
    slow = correlated(20_000, 0.995, 2, 0.5)
    readings = [a + b - 50.0 for a, b in zip(white(20_000, 1.0), slow, strict=True)]
    # 1 + 0.25·399 = 101 for ever longer averages; batches of 256 see a part of it
    assert 10.0 < after(readings).averaged < 150.0


def test_a_move_is_no_noise() -> None:
    readings = [50.0 + 30.0 * (index // 50 % 2) + own - 50.0 for index, own in enumerate(white(2000, 1.0))]
    assert after(readings, moves_every=50).averaged < 1.3
    assert after(readings).averaged > 3.0


def test_a_sensor_without_noise_is_believed_more_and_more() -> None:
    assert after([50.0] * 200).averaged < 0.2
    assert after([50.0] * 2000).averaged < 0.005


def test_a_quantised_sensor_shows_its_step_and_no_other_sensor_has_one() -> None:
    draw, quantised, clean = np.random.default_rng(1), Resolution(), Resolution()
    for place_m in np.cumsum(draw.uniform(1e-4, 3e-3, 40)):
        quantised = quantised.followed_by(round(float(place_m) / 4e-4) * 4e-4)
        clean = clean.followed_by(float(place_m))
    assert quantised.step_m == pytest.approx(4e-4)
    # uniform within a step
    assert quantised.hidden_m2(0.0) == pytest.approx((4e-4) ** 2 / 12.0)
    assert clean.hidden_m2(0.0) == 0.0


def test_noise_of_half_a_step_shows_what_a_quantised_sensor_hides() -> None:
    resolution = Resolution(0.0, 4e-4, 100)
    assert resolution.hidden_m2((2e-4) ** 2) < 1e-3 * resolution.hidden_m2(0.0)


def rest() -> Resting:
    load = Load(52538.0, 1423.0, 612.9)
    filtered = AdaptiveFilter(AdaptationSettings(), MotionModel(1.361, 333.6, 0.0), load)
    return filtered.at_rest(0.08, 1e-6, load, filtered.prior_sigmas())


def test_an_average_stays_as_uncertain_as_what_the_sensor_hides() -> None:
    hidden_m2, noise_m2, stem = 1e-8, 1e-10, rest()
    for _ in range(500):
        stem = average(stem, 0.081, as_one_more_m2(stem, noise_m2, hidden_m2))
    # the prior and one reading with the hidden error
    assert stem.variance_m2 == pytest.approx(1.0 / (1e6 + 1e8), rel=0.01)
    assert stem.x == pytest.approx(0.08 + 1e-3 * 1e8 / (1e6 + 1e8), abs=1e-6)


def test_a_sensor_that_hides_nothing_is_averaged_as_ever() -> None:
    assert as_one_more_m2(rest(), 2e-9, 0.0) == 2e-9


def test_an_outlier_counts_as_the_farthest_reading_that_noise_makes() -> None:
    assert believed_m(0.08, 3e-6, 0.3, 1e-6) == pytest.approx(0.08 + 4.0 * 2e-3)
    assert believed_m(0.08, 3e-6, -0.3, 1e-6) == pytest.approx(0.08 - 4.0 * 2e-3)
    assert believed_m(0.08, 3e-6, 0.087, 1e-6) == 0.087
