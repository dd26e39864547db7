"""The adaptive filter: at rest it is a plain average and the full Kalman filter at once; a landing teaches the load."""

from __future__ import annotations

import math
from dataclasses import astuple, replace

import numpy as np
import pytest
from dense import matrix
from hypothesis import given
from hypothesis import strategies as st

from positioner.laws.nmpc.covariance import independent
from positioner.laws.nmpc.filter import AdaptiveFilter, Sliding, average, spread_of
from positioner.laws.nmpc.settings import AdaptationSettings
from positioner.valve.motion import Load, MotionModel
from positioner.valve.parameters import ValveParameters

VALVE = ValveParameters(id="paper")
NOMINAL = Load.of(VALVE)
SETTINGS = AdaptationSettings()
FILTER = AdaptiveFilter(SETTINGS, MotionModel.of(VALVE), NOMINAL)
SIGMA_M = 1.6e-3
readings = st.lists(st.floats(0.07, 0.09), min_size=1, max_size=40)


def landed() -> Sliding:
    """Return the estimate after a move of 20 ms without readings: everything is correlated with everything."""
    state = FILTER.depart(FILTER.at_rest(0.06, 1e-8, NOMINAL, FILTER.prior_sigmas()), 1.0, 1.0)
    for _ in range(4):
        state = FILTER.advance(state, 18.0, 1e-3)
    while not state.stopped:
        state = FILTER.advance(state, 9.0, 1e-3)
    return state


@given(readings)
def test_at_rest_the_position_is_the_average_of_the_readings_and_the_prior(values: list[float]) -> None:
    rest = FILTER.rest(landed())
    weights = [1.0 / rest.variance_m2, *(SIGMA_M**-2,) * len(values)]
    expected = np.average([rest.x, *values], weights=weights)
    for value in values:
        rest = average(rest, value, SIGMA_M**2)
    assert rest.x == pytest.approx(expected, rel=1e-12)
    assert rest.variance_m2 == pytest.approx(1.0 / sum(weights), rel=1e-12)


@given(readings)
def test_at_rest_the_load_is_that_of_the_full_filter(values: list[float]) -> None:
    rest = FILTER.rest(landed())
    x = np.array([rest.anchor.x, 0.0, *astuple(rest.anchor.load)])
    covariance = matrix(rest.anchor.covariance)
    for value in values:
        gain = covariance[:, 0] / (covariance[0, 0] + SIGMA_M**2)
        x = x + gain * (value - x[0])
        covariance = covariance - np.outer(gain, covariance[0])
        rest = average(rest, value, SIGMA_M**2)
    assert astuple(rest.load) == pytest.approx(tuple(x[2:]), rel=1e-9)
    left = FILTER.depart(rest, -1.0, 0.25)
    covariance[3, 3] += 0.25 * (SETTINGS.friction_per_move * NOMINAL.friction_n) ** 2
    assert np.allclose(matrix(left.covariance), covariance, rtol=1e-9, atol=1e-12 * np.abs(covariance).max())


@pytest.mark.parametrize("error_m", [2e-3, -2e-3])
def test_a_landing_beside_the_prediction_corrects_the_load_that_moved_it_there(error_m: float) -> None:
    rest = FILTER.rest(landed())
    for _ in range(2000):
        rest = average(rest, landed().x + error_m, SIGMA_M**2)
    # farther than predicted: a softer spring, less friction; and the other way round
    assert math.copysign(1.0, rest.load.spring_n_per_m - NOMINAL.spring_n_per_m) == -math.copysign(1.0, error_m)
    assert math.copysign(1.0, rest.load.friction_n - NOMINAL.friction_n) == -math.copysign(1.0, error_m)
    again = FILTER.model.step(0.06, 0.0, 18.0, rest.load, 1.0, 4e-3)
    again = FILTER.model.step(again.x, again.v, 9.0, rest.load, 1.0, 1.0)
    # the corrected load predicts the landing to a tenth of the error; the rest is the error of linearisation
    assert again.x == pytest.approx(landed().x + error_m, abs=abs(error_m) / 10.0)


def test_the_covariance_through_a_stop_is_that_of_many_stems() -> None:
    chance = np.random.default_rng(1)
    sigmas = Load(300.0, 10.0, 4.0)
    state = FILTER.advance(Sliding(0.06, 0.0, NOMINAL, independent(1e-14, sigmas), 1.0), 18.0, 4e-3)
    state = FILTER.advance(state, 9.0, 1.0)
    assert state.stopped
    ends = []
    for dk, df, dc in chance.normal(size=(4000, 3)) * astuple(sigmas):
        load = Load(NOMINAL.spring_n_per_m + dk, NOMINAL.friction_n + df, NOMINAL.viscous_n_s_per_m + dc)
        end = FILTER.model.step(0.06, 0.0, 18.0, load, 1.0, 4e-3)
        ends.append(FILTER.model.step(end.x, end.v, 9.0, load, 1.0, 1.0).x)
    assert float(np.var(ends)) == pytest.approx(state.covariance.xx, rel=0.06)


@pytest.mark.parametrize("parts", [1, 10])
def test_an_unknown_force_moves_the_speed_as_white_noise_does_at_any_period(parts: int) -> None:
    sure = FILTER.at_rest(0.06, 1e-12, NOMINAL, Load(1e-9, 1e-9, 1e-9)).anchor
    state = replace(sure, v=0.5, stopped=False, unforeseen=0.5, covariance=replace(sure.covariance, xx=1e-12))
    for _ in range(parts):
        state = FILTER.advance(state, 14.0, 10e-3 / parts)
    # F²·1 ms/(2 m F_v) after many times m/F_v; the spring makes it a little smaller
    steady = 0.5 * SETTINGS.force_noise_n**2 * 1e-3 / (2.0 * VALVE.mass_kg * VALVE.viscous_friction_n_s_per_m)
    assert state.covariance.vv == pytest.approx(steady, rel=0.2)


def test_the_load_stays_inside_its_limits() -> None:
    rest = FILTER.at_rest(0.08, 1e-6, Load(1.0, 1e9, 1e9), FILTER.prior_sigmas())
    assert astuple(rest.load) == pytest.approx(
        (
            SETTINGS.least * NOMINAL.spring_n_per_m,
            SETTINGS.most * NOMINAL.friction_n,
            SETTINGS.most * NOMINAL.viscous_n_s_per_m,
        )
    )


def test_friction_forbids_a_change_of_sign() -> None:
    covariance = replace(independent(1e-6, Load(1.0, 1.0, 1.0)), xv=9e-5, vv=1e-2)
    moving = Sliding(0.08, 0.01, NOMINAL, covariance, 1.0)
    after = FILTER.correct(moving, 0.075, SIGMA_M**2)
    assert after.stopped
    assert after.v == 0.0


def test_the_spread_of_a_rest_is_what_it_was_given() -> None:
    sigmas = Load(5000.0, 100.0, 50.0)
    assert astuple(spread_of(FILTER.at_rest(0.08, 1e-6, NOMINAL, sigmas))) == pytest.approx(astuple(sigmas))
