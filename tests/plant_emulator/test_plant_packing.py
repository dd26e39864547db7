"""Friction that grows at rest, and that wears: the breakaway at its instant, and the factors of the moves."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plant_cuts import whole_and_cut
from scipy.optimize import brentq

from plant_emulator import valve
from plant_emulator.ageing import Ageing, growth
from plant_emulator.parameters import PackingSettings
from plant_emulator.presets import plant_settings

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings

PAPER = plant_settings("paper")
GAIN_N_PER_MA = PAPER.valve.diaphragm_area_m2 * PAPER.valve.pressure_gain_pa_per_ma
STATIC_N = PAPER.valve.static_friction_n


def aged_n(plant: PlantSettings, rest_s: float) -> float:
    p = plant.packing
    crept = p.creep_fraction * (1.0 - math.exp(-rest_s / p.creep_time_constant_s))
    return STATIC_N * (1.0 + crept + p.growth_per_decade * math.log10(1.0 + rest_s))


def current_ma(pull_n: float) -> float:
    """Return the current in mA that leaves `pull_n` for the friction at the initial position."""
    return (PAPER.valve.spring_rate_n_per_m * 0.01 + pull_n) / GAIN_N_PER_MA


AGEING = ["packing.growth_per_decade = 0.1", "packing.creep_fraction = 0.2\npacking.creep_time_constant_s = 0.5"]


@pytest.mark.parametrize("overrides", AGEING)
@pytest.mark.parametrize("rest_s", [0.3, 9.0, 999.0])
def test_after_a_rest_the_stem_slips_just_above_the_static_friction_that_has_grown(
    overrides: str, rest_s: float
) -> None:
    plant = plant_settings("paper", overrides)
    rested = valve.step(plant, valve.initial_state(plant, 0), current_ma(0.0), rest_s)
    assert rested.packing.static_n == pytest.approx(aged_n(plant, rest_s), rel=1e-12)
    for factor, slips in ((0.99999, 0), (1.00001, 1)):
        pull_n = factor * aged_n(plant, rest_s)
        assert valve.step(plant, rested, current_ma(pull_n), 1e-6).stem.slips == slips


@pytest.mark.parametrize("overrides", AGEING)
@pytest.mark.parametrize("pieces", [1, 13])
def test_a_rising_force_meets_the_growing_friction_where_both_are_equal(overrides: str, pieces: int) -> None:
    plant = plant_settings("paper", overrides + "\nactuator.fill_time_constant_s = 2.0")
    final_n = 1.4 * STATIC_N
    slip_s = brentq(lambda t: final_n * (1.0 - math.exp(-t / 2.0)) - aged_n(plant, t), 0.1, 5.0, xtol=1e-13)
    for late_s, slips in ((-1e-8, 0), (1e-8, 1)):
        state = valve.initial_state(plant, 0)
        for _ in range(pieces):
            state = valve.step(plant, state, current_ma(final_n), (slip_s + late_s) / pieces)
        assert state.stem.slips == slips


def test_a_force_that_friction_outgrows_never_moves_the_stem() -> None:
    plant = plant_settings("paper", "packing.growth_per_decade = 0.5\nactuator.fill_time_constant_s = 3.0")
    # after 8 s F_s has grown by more than 47 %, and the pull is still below 1.3 F_s
    state = valve.step(plant, valve.initial_state(plant, 0), current_ma(1.3 * STATIC_N), 100.0)
    assert state.stem.slips == 0


def test_leaving_the_zero_speed_band_ends_the_growth() -> None:
    plant = plant_settings("paper", AGEING[0])
    rested = valve.step(plant, valve.initial_state(plant, 0), current_ma(0.0), 99.0)
    moving = valve.step(plant, rested, current_ma(1.5 * STATIC_N), 0.01)
    assert moving.stem.velocity_m_per_s > 0.1
    assert moving.packing.static_n == STATIC_N
    # from there on it is the valve without growth: the energy of the jump is that of the spring and of F_c
    stopped = valve.step(plant, moving, current_ma(1.5 * STATIC_N), 0.3)
    prompt = valve.step(PAPER, valve.initial_state(PAPER, 0), current_ma(1.5 * STATIC_N), 0.3)
    assert stopped.stem.position_m == pytest.approx(prompt.stem.position_m, abs=1e-6)
    assert stopped.packing.rested_s < 0.3


def test_slope_and_bend_of_the_growth_are_its_derivatives() -> None:
    packing = PackingSettings(growth_per_decade=0.1, creep_fraction=0.3, creep_time_constant_s=0.7)
    ageing = Ageing(packing, 1000.0, 2.0)
    assert ageing.more_n(3.0) == pytest.approx(1000.0 * (growth(packing, 5.0) - growth(packing, 2.0)), rel=1e-12)
    for t in (0.0, 0.4, 5.0):
        assert ageing.slope(t) == pytest.approx((ageing.more_n(t + 1e-5) - ageing.more_n(t - 1e-5)) / 2e-5, rel=1e-6)
        bends = [abs(ageing.slope(later + 1e-5) - ageing.slope(later - 1e-5)) / 2e-5 for later in (t, t + 0.5, t + 5.0)]
        assert max(bends) <= ageing.bend_bound(t) * (1.0 + 1e-6)
        assert ageing.bend_bound(t) == pytest.approx(bends[0], rel=1e-6)


@pytest.mark.parametrize("travel_stop", [True, False])
def test_time_passes_at_a_travel_stop_while_friction_grows(travel_stop: bool) -> None:
    plant = plant_settings("graphite", {"packing": {"growth_per_decade": 0.1}, "sensor": {"time_constant_s": 0.01}})
    state = valve.initial_state(plant, 0)
    for current in (20.0, 20.0 if travel_stop else 12.0):
        state = valve.step(plant, state, current, 2.0)
        assert valve.measure(plant, state)[1] == pytest.approx(0.03, abs=1e-4)
    assert state.time_s == 4.0


def test_each_stop_changes_both_frictions_by_the_drift() -> None:
    plant = plant_settings("paper", "packing.drift_per_move = 0.01")
    state = valve.initial_state(plant, 0)
    for current in (12.0, 4.0, 16.0, 7.0, 20.0, 4.0):
        state = valve.step(plant, state, current, 0.3)
        factor = 1.0 + 0.01 * state.stem.stops
        assert state.packing.static_n == pytest.approx(factor * STATIC_N, rel=1e-12)
        assert state.packing.coulomb_n == pytest.approx(factor * PAPER.valve.coulomb_friction_n, rel=1e-12)
    assert state.stem.stops >= 4


def test_the_drift_by_time_shows_at_the_next_stop() -> None:
    plant = plant_settings("paper", "packing.drift_per_hour = -0.36")
    state = valve.step(plant, valve.initial_state(plant, 0), current_ma(0.0), 1000.0)
    assert state.packing.static_n == STATIC_N
    state = valve.step(plant, state, 12.0, 0.5)
    stopped_s = 1000.0 + 0.1
    assert state.stem.stops == 1
    assert state.packing.static_n == pytest.approx((1.0 - 0.36 * stopped_s / 3600.0) * STATIC_N, abs=0.05)


def test_wear_leaves_a_part_of_the_friction() -> None:
    plant = plant_settings("paper", "packing.drift_per_hour = -100.0")
    state = valve.step(plant, valve.initial_state(plant, 0), 4.0, 100.0)
    state = valve.step(plant, state, 14.0, 0.5)
    assert state.packing.static_n == pytest.approx(0.05 * STATIC_N, rel=1e-12)


commands = st.lists(st.tuples(st.floats(0.0, 24.0), st.sampled_from([1e-3, 5e-3, 0.05])), min_size=1, max_size=8)


@settings(max_examples=80, deadline=None)
@given(
    st.sampled_from(["paper", "stochastic", "graphite"]),
    st.sampled_from([0.0, 0.003, 0.1]),
    st.sampled_from([(0.1, 0.0), (0.05, 0.2)]),
    st.sampled_from([0.0, -0.01]),
    commands,
    st.integers(2, 30),
)
def test_no_cut_of_time_changes_a_motion_with_growing_friction(
    preset: str,
    lag_s: float,
    ageing: tuple[float, float],
    drift: float,
    sequence: list[tuple[float, float]],
    pieces: int,
) -> None:
    packing = {"growth_per_decade": ageing[0], "creep_fraction": ageing[1], "creep_time_constant_s": 0.02}
    lags = {"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s}
    plant = plant_settings(preset, {"packing": {**packing, "drift_per_move": drift}, "actuator": lags})
    for whole, cut in whole_and_cut(plant, 2, sequence, pieces):
        assert abs(whole.stem.position_m - cut.stem.position_m) < 1e-8
        assert (whole.stem.slips, whole.stem.stops) == (cut.stem.slips, cut.stem.stops)
