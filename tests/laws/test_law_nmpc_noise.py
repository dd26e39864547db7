"""The sensor's noise, learned at rest: white or held, larger or smaller than configured."""

from __future__ import annotations

import numpy as np
import pytest

from positioner.laws.nmpc.sensor_noise import Octave, nothing_learned


def after(readings: list[float], *, moves_every: int = 0) -> Octave:
    level = nothing_learned()
    for index, reading in enumerate(readings):
        if moves_every and index % moves_every == 0:
            level = level.at_new_place()
        level = level.followed_by(reading)
    return level


def white(count: int, sigma: float, seed: int = 1) -> list[float]:
    return [float(each) for each in 50.0 + np.random.default_rng(seed).normal(0.0, sigma, count)]


def test_nothing_learned_is_the_configured_noise() -> None:
    assert nothing_learned().largest == 1.0


@pytest.mark.parametrize("sigma", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_white_noise_is_known_to_a_tenth_after_two_thousand_readings(sigma: float, seed: int) -> None:
    # the variance of n pairs is known to √(3/n): 4 %; the prior weighs 20 pairs
    assert 0.88 * sigma**2 < after(white(2000, sigma, seed)).largest < 1.25 * sigma**2


def test_twice_the_configured_noise_is_noticed_within_a_hundred_readings() -> None:
    # half the true noise would be the severe error: the estimate must be above it soon
    assert after(white(100, 2.0)).largest > 2.0


@pytest.mark.parametrize("held", [4, 10, 32])
def test_noise_that_is_held_counts_as_often_as_it_is_held(held: int) -> None:
    readings = np.repeat(white(800, 1.0), held).tolist()
    # batches of 256 readings see all of it but the part that a batch's borders cut
    assert 0.6 * held < after(readings).largest < 1.3 * held


def test_a_move_is_no_noise() -> None:
    readings = [50.0 + 30.0 * (index // 50 % 2) + own - 50.0 for index, own in enumerate(white(2000, 1.0))]
    assert after(readings, moves_every=50).largest < 1.3
    assert after(readings).largest > 3.0


def test_a_sensor_without_noise_is_believed_more_and_more() -> None:
    assert after([50.0] * 200).largest < 0.15
    assert after([50.0] * 20_000).largest < 0.002
