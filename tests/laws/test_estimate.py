"""The estimator: an average while the stem sticks, a filter while it slides, and the two ends of a stick."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from plant_emulator import valve as plant
from plant_emulator.presets import plant_settings
from positioner.laws.estimator_settings import EstimationMethod, EstimatorSettings, measurement_sigma_m
from positioner.laws.paper.estimator import FilteredStem, _predict, estimate, first_estimate
from positioner.valve.parameters import ValveParameters

VALVE = ValveParameters(id="paper")
FRICTIONLESS = replace(VALVE, static_friction_n=0.0, coulomb_friction_n=0.0)
SIGMA_M = 0.0005
EVEN_NOISE = EstimatorSettings(noise_of_reading=0.0, noise_of_span=SIGMA_M / VALVE.span_m)
NO_NOISE = EstimatorSettings(noise_of_reading=0.0)
PERIOD_S = 0.001


def pull_ma(position_m: float, pull_n: float) -> float:
    """Return the current that pulls with `pull_n` on a stem at `position_m`."""
    return VALVE.balance_current_ma(position_m) + pull_n / VALVE.force_gain_n_per_ma


def test_the_noise_of_a_reading_is_a_part_of_it_and_of_the_span_and_never_nothing() -> None:
    both = EstimatorSettings(noise_of_reading=0.02, noise_of_span=0.001)
    assert measurement_sigma_m(both, VALVE, -0.08) == pytest.approx(0.02 * 0.08 + 0.001 * 0.127)
    assert measurement_sigma_m(NO_NOISE, VALVE, 0.08) == 1e-6


def test_the_first_estimate_rests_where_it_was_measured() -> None:
    state = first_estimate(EVEN_NOISE, VALVE, 0.08)
    assert (state.position_m, state.velocity_m_per_s, state.stuck) == (0.08, 0.0, True)
    assert state.position_sigma_m == pytest.approx(SIGMA_M)
    assert not first_estimate(EVEN_NOISE, FRICTIONLESS, 0.08).stuck


def test_a_variance_that_rounding_made_negative_has_no_sigma() -> None:
    assert FilteredStem(0.08, 0.0, True, 1.0, -1e-30, 0.0, 0.0).position_sigma_m == 0.0


def test_while_the_stem_sticks_the_filter_is_a_plain_average() -> None:
    readings = 0.08 + SIGMA_M * np.random.default_rng(1).standard_normal(400)
    held_ma = pull_ma(0.08, 0.5 * VALVE.static_friction_n)
    state = first_estimate(EVEN_NOISE, VALVE, float(readings[0]))
    for number, reading in enumerate(readings[1:], start=2):
        state = estimate(EVEN_NOISE, VALVE, state, float(reading), held_ma, PERIOD_S)
        assert state.p_xx == pytest.approx(SIGMA_M**2 / number, rel=1e-9)
        assert state.position_m == pytest.approx(float(readings[:number].mean()), abs=1e-12)
        assert (state.velocity_m_per_s, state.p_vv, state.stuck) == (0.0, 0.0, True)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_stick_holds_up_to_static_friction_and_not_beyond(sign: float) -> None:
    state = first_estimate(EVEN_NOISE, VALVE, 0.08)
    held = estimate(EVEN_NOISE, VALVE, state, 0.08, pull_ma(0.08, sign * 0.999 * VALVE.static_friction_n), PERIOD_S)
    assert held.stuck
    left = estimate(EVEN_NOISE, VALVE, state, 0.08, pull_ma(0.08, sign * 1.001 * VALVE.static_friction_n), PERIOD_S)
    assert not left.stuck
    assert left.direction == sign
    assert sign * left.velocity_m_per_s > 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_stem_that_left_without_the_model_is_noticed_and_its_reading_believed(sign: float) -> None:
    held_ma = VALVE.balance_current_ma(0.08)
    state = first_estimate(EVEN_NOISE, VALVE, 0.08)
    for _ in range(200):
        state = estimate(EVEN_NOISE, VALVE, state, 0.08, held_ma, PERIOD_S)
    moved_m = 0.08 + sign * 4.0 * SIGMA_M
    samples = 0
    while state.stuck:
        state = estimate(EVEN_NOISE, VALVE, state, moved_m, held_ma, PERIOD_S)
        samples += 1
        assert samples < 20
    # 4 sigma, smoothed over ten samples, pass 4.5 sigma of the smoothed value: 4 (1 - 0.9^n) > 4.5 sqrt(0.1 / 1.9)
    assert samples == math.ceil(math.log(1.0 - 4.5 * math.sqrt(0.1 / 1.9) / 4.0) / math.log(0.9))
    assert (state.position_m, state.direction) == (moved_m, sign)
    assert state.position_sigma_m == pytest.approx(SIGMA_M)
    assert math.sqrt(state.p_vv) == pytest.approx(0.3)


def test_noise_alone_does_not_end_a_stick() -> None:
    readings = 0.08 + SIGMA_M * np.random.default_rng(2).standard_normal(5000)
    state = first_estimate(EVEN_NOISE, VALVE, 0.08)
    for reading in readings:
        state = estimate(EVEN_NOISE, VALVE, state, float(reading), VALVE.balance_current_ma(0.08), PERIOD_S)
        assert state.stuck
    assert state.position_m == pytest.approx(0.08, abs=4.0 * SIGMA_M / math.sqrt(5000))


def test_a_frictionless_valve_never_sticks_not_even_in_balance() -> None:
    state = first_estimate(NO_NOISE, FRICTIONLESS, 0.08)
    for _ in range(5):
        state = estimate(NO_NOISE, FRICTIONLESS, state, 0.08, FRICTIONLESS.balance_current_ma(0.08), PERIOD_S)
        assert not state.stuck


def test_without_friction_a_correction_may_turn_the_speed_round() -> None:
    moving = FilteredStem(0.08, 0.001, False, 1.0, 1e-6, 1e-4, 0.02)
    state = estimate(NO_NOISE, FRICTIONLESS, moving, 0.079, FRICTIONLESS.balance_current_ma(0.08), 1e-4)
    assert state.velocity_m_per_s < 0.0
    assert state.direction == -1.0


moving_states = st.builds(
    lambda x, speed, direction, sigma_x, sigma_v, correlation: FilteredStem(
        x, direction * speed, False, direction, sigma_x**2, correlation * sigma_x * sigma_v, sigma_v**2
    ),
    st.floats(0.02, 0.12),
    st.floats(0.0, 1.0),
    st.sampled_from([-1.0, 1.0]),
    st.floats(1e-5, 2e-3),
    st.floats(1e-4, 0.5),
    st.floats(-0.99, 0.99),
)


@settings(max_examples=300)
@given(moving_states, st.floats(0.0, 0.14), st.floats(4.0, 20.0), st.sampled_from([1e-4, 1e-3, 5e-3]))
@example(FilteredStem(0.05078125, -0.0, False, -1.0, 3.8e-6, 0.0, 0.25), 0.03125, 12.0, 1e-4)  # a far correction
def test_friction_stops_a_stem_before_its_speed_changes_sign(
    state: FilteredStem, measured_m: float, applied_ma: float, period_s: float
) -> None:
    after = estimate(EstimatorSettings(), VALVE, state, measured_m, applied_ma, period_s)
    pushed = math.copysign(1.0, VALVE.net_force_n(state.position_m, applied_ma))
    direction = state.direction if state.velocity_m_per_s else pushed
    assert direction * after.velocity_m_per_s >= 0.0
    assert not (after.stuck and after.velocity_m_per_s)
    # it rests where static friction holds it, and nowhere else: where the model stopped it, or where the reading did
    modelled = _predict(EstimatorSettings(), VALVE, state, applied_ma, period_s)
    resting_m = modelled.position_m if modelled.stuck else after.position_m
    if after.stuck:
        assert abs(VALVE.net_force_n(resting_m, applied_ma)) <= VALVE.static_friction_n


@settings(max_examples=300)
@given(moving_states, st.floats(0.0, 0.14), st.floats(4.0, 20.0), st.sampled_from([1e-4, 1e-3, 5e-3]))
def test_the_covariance_stays_one(state: FilteredStem, measured_m: float, applied_ma: float, period_s: float) -> None:
    after = estimate(EstimatorSettings(), VALVE, state, measured_m, applied_ma, period_s)
    assert after.p_xx >= 0.0
    assert after.p_vv >= -1e-12
    assert after.p_xv**2 <= after.p_xx * after.p_vv * (1.0 + 1e-6) + 1e-18


def test_a_stem_that_turns_round_rests_for_an_instant_without_sticking() -> None:
    # moving up into a pull far below -F_s: it stops, and is pushed back
    moving = FilteredStem(0.08, 0.05, False, 1.0, 1e-10, 0.0, 1e-8)
    state = estimate(NO_NOISE, VALVE, moving, 0.08, 4.0, PERIOD_S)
    assert (state.velocity_m_per_s, state.stuck, state.direction) == (0.0, False, -1.0)
    state = estimate(NO_NOISE, VALVE, state, state.position_m, 4.0, PERIOD_S)
    assert state.velocity_m_per_s < -0.1


def test_a_correction_that_stops_the_stem_sticks_it_only_where_friction_holds() -> None:
    moving = FilteredStem(0.08, 0.001, False, 1.0, 1e-6, 9e-5, 0.01)
    sticking = estimate(EVEN_NOISE, VALVE, moving, 0.0785, pull_ma(0.08, VALVE.coulomb_friction_n + 10.0), 1e-4)
    assert (sticking.velocity_m_per_s, sticking.stuck, sticking.p_vv) == (0.0, True, 0.0)
    pulled = estimate(EVEN_NOISE, VALVE, moving, 0.0785, pull_ma(0.08, VALVE.static_friction_n + 100.0), 1e-4)
    assert (pulled.velocity_m_per_s, pulled.stuck, pulled.direction) == (0.0, False, 1.0)
    assert pulled.p_vv > 0.0


def follow(noise: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return true and estimated position and speed, and both sticks, while the emulated valve slips and stops twice."""
    settings_of_plant = plant_settings("paper", {"valve": {"initial_position_m": 0.06}})
    state = plant.initial_state(settings_of_plant, seed)
    random = np.random.default_rng(seed)
    tuning = EstimatorSettings(noise_of_reading=noise)
    stem = first_estimate(tuning, VALVE, 0.06)
    hold_ma = VALVE.balance_current_ma(0.06)
    currents_ma = [hold_ma] * 200 + [hold_ma + 5.6] * 150 + [hold_ma + 5.6 - 1.0] * 100 + [hold_ma - 6.0] * 200
    truth, guess = [], []
    for current_ma in currents_ma:
        state = plant.step(settings_of_plant, state, current_ma, PERIOD_S)
        reading = state.stem.position_m * (1.0 + noise * float(random.standard_normal()))
        stem = estimate(tuning, VALVE, stem, reading, current_ma, PERIOD_S)
        truth.append((state.stem.position_m, state.stem.velocity_m_per_s, state.stem.is_at_rest))
        guess.append((stem.position_m, stem.velocity_m_per_s, stem.stuck))
    (x, v, stuck), (found_x, found_v, found_stuck) = np.array(truth).T, np.array(guess).T
    return found_x - x, found_v - v, stuck, found_stuck


def test_without_noise_the_estimate_follows_the_emulated_valve() -> None:
    # the emulator has Karnopp's band and the Stribeck term, the model does not: the tolerances allow for this
    error_x, error_v, stuck, found = follow(0.0, 1)
    assert 1e-8 < np.abs(error_x).max() < 1e-6
    assert 1e-5 < np.abs(error_v).max() < 2e-3
    # both slips end without a reversal: a stem below DV counts as resting, as in the plant
    assert np.mean(stuck != found) < 0.01


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_with_two_percent_of_noise_the_estimate_is_far_better_than_a_reading(seed: int) -> None:
    error_x, _, _, _ = follow(0.02, seed)
    reading_sigma_m = 0.02 * 0.06
    assert 0.1 * reading_sigma_m < np.sqrt(np.mean(error_x**2)) < 0.3 * reading_sigma_m


RAW = EstimatorSettings(method=EstimationMethod.RAW, noise_of_reading=0.02)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_raw_method_believes_each_reading_and_takes_the_difference_for_the_speed(sign: float) -> None:
    state = estimate(RAW, VALVE, first_estimate(RAW, VALVE, 0.08), 0.08 + sign * 1e-4, 12.0, PERIOD_S)
    assert (state.position_m, state.stuck, state.direction) == (0.08 + sign * 1e-4, False, sign)
    assert state.velocity_m_per_s == pytest.approx(sign * 0.1)
    sigma_m = 0.02 * state.position_m
    assert state.p_xx == pytest.approx(sigma_m**2)
    assert state.p_vv == pytest.approx(2.0 * (sigma_m / PERIOD_S) ** 2)
    assert state.p_xv == pytest.approx(sigma_m**2 / PERIOD_S)


def test_the_raw_method_takes_a_stem_below_dv_for_stuck_where_there_is_friction() -> None:
    moving = FilteredStem(0.08, -0.1, False, -1.0, 1e-6, 0.0, 0.0)
    just_m = VALVE.stick_velocity_m_per_s * PERIOD_S
    stuck = estimate(RAW, VALVE, moving, 0.08 + 0.99 * just_m, 12.0, PERIOD_S)
    assert (stuck.stuck, stuck.velocity_m_per_s, stuck.direction, stuck.p_vv) == (True, 0.0, -1.0, 0.0)
    assert not estimate(RAW, VALVE, moving, 0.08 + 1.01 * just_m, 12.0, PERIOD_S).stuck
    still = estimate(RAW, FRICTIONLESS, moving, 0.08, 12.0, PERIOD_S)
    assert (still.stuck, still.velocity_m_per_s, still.direction) == (False, 0.0, -1.0)
