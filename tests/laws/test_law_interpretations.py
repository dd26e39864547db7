"""The interpretations of the paper: the sensor, the estimate and the movable bound of each."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant_emulator.presets import plant_settings
from positioner.bench.inprocess import InProcessRun, configure, run_in_process
from positioner.bench.scenario import Scenario, load_scenario
from positioner.cli.main import main
from positioner.cycle.events import Learned
from positioner.errors import BenchError, ConfigurationError, ExitCode
from positioner.inputs.toml_reader import build
from positioner.laws.estimator_settings import EstimationMethod, EstimatorSettings
from positioner.laws.paper.bounds import approach_speed_limit_m_per_s
from positioner.laws.paper.estimator import estimate, first_estimate
from positioner.studies.interpretations import Interpretation, NoiseKind, Units, interpretations, interpreted_as
from positioner.valve.parameters import ValveParameters
from positioner.valve.stiction import Quantity

if TYPE_CHECKING:
    from positioner.laws.paper.estimator import FilteredStem

VALVE = ValveParameters(id="paper")
FRICTIONLESS = replace(VALVE, static_friction_n=0.0, coulomb_friction_n=0.0)
RAW = EstimatorSettings(method=EstimationMethod.RAW)
PERIOD_S = 1e-4
BAND_M = VALVE.stick_velocity_m_per_s * PERIOD_S
"""Motion in one sample at the border of Karnopp's zero-speed band."""

SI = {noise: Interpretation(noise, Units.SI) for noise in NoiseKind}


def resting(position_m: float = 0.08) -> FilteredStem:
    return first_estimate(RAW, VALVE, position_m)


@given(st.floats(0.0, 0.14), st.floats(0.0, 0.14), st.floats(4.0, 20.0), st.sampled_from([1e-4, 1e-3, 5e-3]))
def test_a_raw_position_is_the_reading_and_its_speed_the_difference_quotient(
    before_m: float, reading_m: float, applied_ma: float, elapsed_s: float
) -> None:
    state = estimate(RAW, VALVE, resting(before_m), reading_m, applied_ma, elapsed_s)
    assert state.position_m == reading_m
    quotient = (reading_m - before_m) / elapsed_s
    assert state.velocity_m_per_s == (0.0 if abs(quotient) < VALVE.stick_velocity_m_per_s else quotient)
    assert state.stuck == (state.velocity_m_per_s == 0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_raw_stem_sticks_inside_karnopps_band_and_not_outside(sign: float) -> None:
    inside = estimate(RAW, VALVE, resting(), 0.08 + sign * 0.99 * BAND_M, 12.0, PERIOD_S)
    assert (inside.stuck, inside.velocity_m_per_s) == (True, 0.0)
    outside = estimate(RAW, VALVE, resting(), 0.08 + sign * 1.01 * BAND_M, 12.0, PERIOD_S)
    assert (outside.stuck, outside.direction) == (False, sign)
    assert sign * outside.velocity_m_per_s == pytest.approx(1.01 * VALVE.stick_velocity_m_per_s)
    # the direction of a move outlives it: a stop is learned under it
    assert estimate(RAW, VALVE, outside, outside.position_m, 12.0, PERIOD_S).direction == sign


def test_a_raw_stem_without_friction_never_sticks() -> None:
    state = first_estimate(RAW, FRICTIONLESS, 0.08)
    for reading_m in (0.08, 0.08 + 0.5 * BAND_M):
        state = estimate(RAW, FRICTIONLESS, state, reading_m, 12.0, PERIOD_S)
        assert not state.stuck
    assert state.velocity_m_per_s == pytest.approx(0.5 * VALVE.stick_velocity_m_per_s)


def test_the_uncertainty_of_a_raw_speed_is_that_of_two_readings() -> None:
    state = estimate(RAW, VALVE, resting(), 0.081, 12.0, PERIOD_S)
    sigma_m = 0.02 * 0.081
    assert state.position_sigma_m == pytest.approx(sigma_m)
    assert state.p_vv == pytest.approx(2.0 * (sigma_m / PERIOD_S) ** 2)
    assert state.p_xv**2 < state.p_xx * state.p_vv


def test_the_filter_is_the_default_and_an_unknown_method_is_refused() -> None:
    assert EstimatorSettings().method is EstimationMethod.KALMAN
    assert build({"method": "raw"}, EstimatorSettings, "estimator") == RAW
    with pytest.raises(ConfigurationError, match="'kalman' or 'raw'"):
        build({"method": "median"}, EstimatorSettings, "estimator")


def short(simulation: int, interpretation: Interpretation, dwell_s: float = 0.02) -> Scenario:
    return replace(
        interpreted_as(load_scenario(f"paper-{simulation}"), interpretation.noise, interpretation.units),
        visits=1,
        dwell_s=dwell_s,
    )


@pytest.fixture(scope="module")
def played() -> dict[NoiseKind, InProcessRun]:
    """Return the runs of simulation 2 in every interpretation of the noise, with 20 ms for each setpoint."""
    return {noise: run_in_process(short(2, SI[noise])) for noise in NoiseKind}


def test_the_filtered_noise_is_white_and_two_percent(played: dict[NoiseKind, InProcessRun]) -> None:
    recording = played[NoiseKind.FILTERED].recording
    noise = recording.measured_m / recording.true_position_m - 1.0
    assert len(noise) == 600
    # four standard errors of a standard deviation and of a correlation from 600 draws
    assert np.std(noise) == pytest.approx(0.02, rel=4.0 / np.sqrt(1200.0))
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 4.0 / np.sqrt(600.0)


def test_the_raw_noise_is_drawn_every_ten_milliseconds(played: dict[NoiseKind, InProcessRun]) -> None:
    recording = played[NoiseKind.RAW].recording
    noise = (recording.measured_m / recording.true_position_m - 1.0).reshape(6, 100)
    # the frames carry 10 nm
    assert np.ptp(noise, axis=1).max() < 2e-8 / 0.01
    assert np.abs(np.diff(noise[:, 0])).min() > 1e-4
    assert np.abs(noise).max() < 0.08


def test_without_noise_a_raw_speed_is_the_true_mean_speed(played: dict[NoiseKind, InProcessRun]) -> None:
    run = played[NoiseKind.FREE]
    guess = np.array([cycle.stem.velocity_m_per_s for cycle in run.cycles])
    truth = np.diff(run.recording.true_position_m, prepend=run.recording.true_position_m[0]) / PERIOD_S
    assert np.abs(truth).max() > 0.5
    # one bit of the frame, 10 nm, or Karnopp's band, below which a speed counts as none
    np.testing.assert_allclose(guess, truth, atol=VALVE.stick_velocity_m_per_s + 1e-9)


def test_without_noise_every_breakaway_that_is_learned_raw_overcomes_static_friction(
    played: dict[NoiseKind, InProcessRun],
) -> None:
    events = (event for event in played[NoiseKind.FREE].events if isinstance(event, Learned))
    samples = [event.sample for event in events if event.sample.quantity is Quantity.BREAKAWAY_CURRENT]
    assert len(samples) >= 2
    for sample in samples:
        push_n = sample.direction.sign * VALVE.net_force_n(sample.position_m, sample.value)
        assert VALVE.static_friction_n <= push_n <= VALVE.force_gain_n_per_ma * 20.0


def test_alpha_and_beta_are_read_in_si_or_in_centimetres() -> None:
    # the paper's example, 0.97 cm away and 0.04 cm/s learned: eq. 27 gives 5.04 cm/s
    limits = {}
    for units in Units:
        configuration = configure(short(3, Interpretation(NoiseKind.FILTERED, units)))
        limits[units] = approach_speed_limit_m_per_s(configuration.control.bounds, 0.0097, 0.0004)
    assert limits[Units.CENTIMETRES] == pytest.approx(0.0504, rel=1e-9)
    assert limits[Units.SI] == pytest.approx(5.0 * (1.0 - np.exp(-1.455)) + 0.0004)


@pytest.mark.parametrize(
    ("noise", "method", "fraction", "hold_s"),
    [
        (NoiseKind.FILTERED, EstimationMethod.KALMAN, 0.02, 0.0),
        (NoiseKind.RAW, EstimationMethod.RAW, 0.02, 0.01),
        (NoiseKind.FREE, EstimationMethod.RAW, 0.0, 0.0),
    ],
)
def test_an_interpretation_sets_sensor_and_estimator_and_leaves_the_valve_alone(
    noise: NoiseKind, method: EstimationMethod, fraction: float, hold_s: float
) -> None:
    scenario = short(4, SI[noise])
    plant = plant_settings(overrides=scenario.plant)
    assert (plant.sensor.noise_of_reading, plant.sensor.noise_hold_s) == (fraction, hold_s)
    assert configure(scenario).estimator.method is method
    assert plant.valve == plant_settings("spring-10").valve
    assert configure(scenario).valve == configure(load_scenario("paper-4")).valve


def test_the_packaged_scenario_is_interpretation_a_in_si() -> None:
    scenario = load_scenario("paper-3")
    read = interpreted_as(scenario, NoiseKind.FILTERED, Units.SI)
    assert configure(read) == configure(scenario)
    assert plant_settings(overrides=read.plant) == plant_settings(overrides=scenario.plant)


def test_every_choice_of_noise_comes_with_its_control_run_in_both_units() -> None:
    assert [str(each) for each in interpretations((NoiseKind.RAW,))] == [
        "B, SI",
        "B, cm",
        "noise-free, SI",
        "noise-free, cm",
    ]


@pytest.mark.parametrize(
    ("arguments", "method", "hold_s", "noise", "span_m_per_s"),
    [
        ([], EstimationMethod.KALMAN, 0.0, 0.02, 5.0),
        (["--reading", "A"], EstimationMethod.KALMAN, 0.0, 0.02, 5.0),
        (["--reading", "B"], EstimationMethod.RAW, 0.01, 0.02, 5.0),
        (["--reading", "noise-free", "--units", "SI"], EstimationMethod.RAW, 0.0, 0.0, 5.0),
        (["--units", "cm", "--law", "paper-plain"], EstimationMethod.KALMAN, 0.0, 0.02, 0.05),
    ],
)
def test_the_bench_plays_a_scenario_in_the_given_interpretation(
    arguments: list[str],
    method: EstimationMethod,
    hold_s: float,
    noise: float,
    span_m_per_s: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    played: list[Scenario] = []

    def run_bench(scenario: Scenario, *_: object) -> None:
        played.append(scenario)
        raise BenchError("seen enough")

    monkeypatch.setattr("positioner.bench.runner.run_bench", run_bench)
    assert main(["bench", "--scenario", "paper-3", *arguments]) == ExitCode.FAILURE
    (scenario,) = played
    sensor = plant_settings(overrides=scenario.plant).sensor
    configuration = configure(scenario)
    assert configuration.estimator.method is method
    assert (sensor.noise_hold_s, sensor.noise_of_reading) == (hold_s, noise)
    assert configuration.control.bounds.approach_span_m_per_s == span_m_per_s
    assert configuration.control.table_from_s == 3.0
    assert configuration.control.law == ("paper-plain" if "--law" in arguments else "paper")


def test_an_interpretation_changes_only_the_settings_that_it_names() -> None:
    scenario = load_scenario("paper-4")
    assert interpreted_as(scenario, None, None) == scenario
