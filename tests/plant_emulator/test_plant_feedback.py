"""The linkage and the lag of the sensor: closed forms, and independence of the steps."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plant_cuts import whole_and_cut

from plant_emulator import valve
from plant_emulator.feedback import Feedback, after_motion, after_rest
from plant_emulator.path import Knots, Uniform
from plant_emulator.presets import plant_settings
from plant_emulator.sensor_settings import SensorSettings

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings
    from plant_emulator.valve import PlantState

QUIET = "sensor.noise_of_reading = 0.0\n"


def shown_m(plant: PlantSettings, state: PlantState) -> float:
    return valve.measure(plant, state)[1]


def test_a_reading_approaches_a_resting_stem_exponentially() -> None:
    after = after_rest(SensorSettings(time_constant_s=0.02), Feedback(0.05, 0.03), 0.03)
    assert after.shown_m == pytest.approx(0.05 - 0.02 * math.exp(-1.5), rel=1e-14)


def test_the_reading_of_a_steady_motion_lags_by_speed_times_lag() -> None:
    sensor = SensorSettings(time_constant_s=0.02)
    after = after_motion(sensor, Feedback(0.01, 0.01), Uniform(0.01, 0.3), 0.01 + 0.3 * 0.05, 0.05)
    behind_m = 0.3 * 0.02 * (1.0 - math.exp(-2.5))
    assert after.shown_m == pytest.approx(0.01 + 0.3 * 0.05 - behind_m, rel=1e-12)
    assert after.lever_m == 0.01 + 0.3 * 0.05


def test_knots_give_back_a_polynomial_of_degree_five_and_its_lag() -> None:
    # x = t^5 about: its lag ∫ s·e^(-s(T-t))·t^5 dt by repeated integration by parts
    knots = [(t, t**5, 5 * t**4, 20 * t**3) for t in (0.0, 0.3, 0.5, 1.2)]
    path = Knots(knots)
    for t in (0.0, 0.1, 0.4, 0.77, 1.2):
        assert path.position(t) == pytest.approx(t**5, abs=1e-14)
    for rate in (0.1, 2.0, 30.0):
        for t in (0.2, 0.5, 1.2):
            derivatives = (t**5, 5 * t**4, 20 * t**3, 60 * t**2, 120 * t, 120.0)
            series = sum((-1) ** k * d / rate**k for k, d in enumerate(derivatives))
            expected = series + 120.0 / rate**5 * math.exp(-rate * t)
            assert path.lagged(t, rate) == pytest.approx(expected, abs=3e-9 if rate > 1.0 else 1e-6)


def test_the_lever_follows_half_a_backlash_behind_and_rests_for_a_whole_one_when_the_stem_turns() -> None:
    sensor = SensorSettings(backlash_m=0.002)
    feedback = Feedback(0.01, 0.01)
    for start_m, end_m, lever_m in (
        (0.01, 0.0105, 0.01),
        (0.0105, 0.02, 0.019),
        (0.02, 0.018, 0.019),
        (0.018, 0.01, 0.011),
    ):
        feedback = after_motion(sensor, feedback, Uniform(start_m, (end_m - start_m) / 0.1), end_m, 0.1)
        assert feedback.lever_m == feedback.shown_m == pytest.approx(lever_m, abs=1e-15)


def test_behind_a_backlash_the_lag_begins_when_the_play_is_taken_up() -> None:
    sensor = SensorSettings(backlash_m=0.002, time_constant_s=0.02)
    after = after_motion(sensor, Feedback(0.01, 0.012), Uniform(0.01, 0.1), 0.02, 0.1)
    # the play of 1 mm is taken up after 10 ms; the lever then starts at 0.01 with 0.1 m/s
    first_m = 0.01 + 0.002 * math.exp(-0.5)
    fading = math.exp(-0.09 / 0.02)
    assert after.lever_m == 0.019
    assert after.shown_m == pytest.approx(first_m * fading + 0.01 * (1 - fading) + 0.1 * (0.09 - 0.02 * (1 - fading)))


def test_a_lagging_sensor_shows_a_slip_of_the_papers_valve_later_by_its_lag() -> None:
    # the integral of what the reading still lacks is the jump times the time constant
    plant = plant_settings("paper", QUIET + "sensor.time_constant_s = 0.01")
    v = plant.valve
    gain = v.diaphragm_area_m2 * v.pressure_gain_pa_per_ma
    state = valve.initial_state(plant, 0)
    current_ma = (v.spring_rate_n_per_m * 0.01 + 1.001 * v.static_friction_n) / gain
    lacking, step_s = 0.0, 1e-4
    for _ in range(4000):
        before = state
        state = valve.step(plant, state, current_ma, step_s)
        ends = before.stem.position_m - shown_m(plant, before), state.stem.position_m - shown_m(plant, state)
        lacking += 0.5 * step_s * (ends[0] + ends[1])
    jump_m = state.stem.position_m - 0.01
    assert jump_m > 5e-3
    assert shown_m(plant, state) == pytest.approx(state.stem.position_m, abs=1e-12)
    assert lacking == pytest.approx(0.01 * jump_m, rel=1e-5)


def test_backlash_hides_half_its_width_of_the_position_at_most() -> None:
    plant = plant_settings("paper", QUIET + "sensor.backlash_m = 0.0006")
    state = valve.initial_state(plant, 0)
    for current_ma in (12.0, 4.0, 16.0, 7.0, 20.0, 4.0):
        for _ in range(40):
            state = valve.step(plant, state, current_ma, 0.001)
            assert abs(shown_m(plant, state) - state.stem.position_m) <= 0.0003 + 1e-15
    # after a long closing motion the lever is pushed from above
    assert shown_m(plant, state) - state.stem.position_m == pytest.approx(0.0003, abs=1e-12)


commands = st.lists(st.tuples(st.floats(0.0, 24.0), st.sampled_from([1e-3, 5e-3, 0.05])), min_size=1, max_size=10)
plants = st.builds(
    lambda preset, lag_s, backlash_m, fill_s, converter_s, slew: plant_settings(
        preset,
        {
            "sensor": {"time_constant_s": lag_s, "backlash_m": backlash_m, "noise_of_reading": 0.0, "noise_of_span": 0},
            "actuator": {
                "fill_time_constant_s": fill_s,
                "converter_time_constant_s": converter_s,
                "slew_pa_per_s": slew,
            },
        },
    ),
    st.sampled_from(["paper", "frictionless", "stochastic", "graphite"]),
    st.sampled_from([0.0005, 0.0086701, 0.05]),
    st.sampled_from([0.0, 0.0004]),
    st.sampled_from([0.0, 0.0086701, 0.1]),
    st.sampled_from([0.0, 0.005]),
    st.sampled_from([0.0, 6e5]),
)


@settings(max_examples=100, deadline=None)
@given(plants, commands, st.integers(2, 30), st.integers(0, 50))
def test_no_cut_of_time_changes_the_reading(
    plant: PlantSettings, sequence: list[tuple[float, float]], pieces: int, seed: int
) -> None:
    for whole, cut in whole_and_cut(plant, seed, sequence, pieces):
        assert abs(shown_m(plant, whole) - shown_m(plant, cut)) < 1e-8
        assert (whole.stem.slips, whole.stem.stops) == (cut.stem.slips, cut.stem.stops)
