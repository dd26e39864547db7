"""Karnopp's friction and its variation: curve, bounds, spread, seeds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from plant_emulator import valve
from plant_emulator.friction import CELL_WIDTH_M, after_crossing, after_stop, initial_packing, stribeck_n
from plant_emulator.presets import plant_settings

STOCHASTIC = plant_settings("stochastic")
STATIC = STOCHASTIC.valve.static_friction_n


def test_stribecks_curve_falls_from_static_to_coulomb_friction() -> None:
    assert stribeck_n(0.0, 1707.7, 1423.0, 0.000254) == 1707.7
    assert stribeck_n(0.000254, 1707.7, 1423.0, 0.000254) == pytest.approx(1423.0 + 284.7 / math.e)
    assert stribeck_n(0.1, 1707.7, 1423.0, 0.000254) == 1423.0


def test_friction_without_variation_is_the_same_everywhere() -> None:
    settings = plant_settings("paper")
    packing = initial_packing(settings, 5)
    assert (packing.static_n, packing.coulomb_n) == (1707.7, 1423.0)
    assert after_stop(settings, packing, 1) == packing


def test_stochastic_friction_stays_within_its_bounds_and_has_its_spread() -> None:
    factors = np.array([initial_packing(STOCHASTIC, seed).static_n / STATIC - 1.0 for seed in range(1500)])
    assert np.abs(factors).max() <= 0.1
    # half a uniform draw (variance 1/3), half the mean of two sines of random phase (variance 1/4)
    expected = 0.1 * 0.5 * math.sqrt(1 / 3 + 1 / 4)
    assert factors.std() == pytest.approx(expected, rel=0.08)
    assert factors.mean() == pytest.approx(0.0, abs=4.0 * expected / math.sqrt(len(factors)))


def test_the_position_half_changes_at_cell_borders_and_the_other_half_at_stops() -> None:
    packing = initial_packing(STOCHASTIC, 7)
    moved = after_crossing(STOCHASTIC, packing, 1)
    assert moved.cell == packing.cell + 1
    assert moved.draw == packing.draw
    assert 0.0 < abs(moved.static_n - packing.static_n) < 0.1 * STATIC * 0.15
    assert after_crossing(STOCHASTIC, moved, -1) == packing
    stopped = after_stop(STOCHASTIC, packing, 1)
    assert stopped.cell == packing.cell
    assert stopped.draw != packing.draw
    assert stopped.static_n - packing.static_n == pytest.approx(0.05 * STATIC * (stopped.draw - packing.draw))


def test_coulomb_friction_varies_with_static_friction() -> None:
    packing = initial_packing(STOCHASTIC, 11)
    assert packing.coulomb_n / STOCHASTIC.valve.coulomb_friction_n == pytest.approx(packing.static_n / STATIC)


def test_the_cell_follows_a_sliding_stem() -> None:
    state = valve.initial_state(STOCHASTIC, 2)
    for current in (9.0, 2.0, 12.0, 7.0):
        state = valve.step(STOCHASTIC, state, current, 0.0213)
        assert state.packing.cell * CELL_WIDTH_M <= state.stem.position_m <= (state.packing.cell + 1) * CELL_WIDTH_M
    assert state.stem.stops >= 1


def test_the_breakaway_force_is_the_static_friction_at_the_position() -> None:
    state = valve.initial_state(STOCHASTIC, 4)
    v = STOCHASTIC.valve
    breakaway_ma = (v.spring_rate_n_per_m * state.stem.position_m + state.packing.static_n) / (
        v.diaphragm_area_m2 * v.pressure_gain_pa_per_ma
    )
    assert valve.step(STOCHASTIC, state, breakaway_ma - 1e-6, 1.0).stem.slips == 0
    assert valve.step(STOCHASTIC, state, breakaway_ma + 1e-6, 1.0).stem.slips >= 1


def test_a_seed_repeats_its_plant_to_the_bit_and_another_does_not() -> None:
    def end(seed: int) -> float:
        state = valve.initial_state(STOCHASTIC, seed)
        for current in (7.5, 4.0, 9.0):
            state = valve.step(STOCHASTIC, state, current, 0.2)
        return state.stem.position_m

    assert end(1) == end(1)
    assert abs(end(1) - end(2)) > 1e-6


BY_PLACE = plant_settings(
    "paper", "packing.place_fraction = 0.3\npacking.direction_fraction = 0.1\npacking.place_period_m = 0.02"
)


def waves(position_m: float) -> tuple[float, float]:
    """Return the waves of size and direction in the middle of the friction cell at `position_m`."""
    centre_m = (math.floor(position_m / CELL_WIDTH_M) + 0.5) * CELL_WIDTH_M
    return 0.3 * math.sin(math.tau * centre_m / 0.02), 0.1 * math.cos(math.tau * centre_m / 0.02)


@pytest.mark.parametrize("place_m", [0.0601, 0.0649, 0.0702, 0.0751])
def test_friction_by_place_holds_the_stem_in_each_direction_as_the_waves_say(place_m: float) -> None:
    plant = replace(BY_PLACE, valve=replace(BY_PLACE.valve, initial_position_m=place_m))
    v, (size, one_way) = plant.valve, waves(place_m)
    rested = valve.initial_state(plant, 0)
    for direction in (1.0, -1.0):
        pull_n = v.static_friction_n * (direction * (1.0 + size) + one_way)
        for factor, slips in ((0.99999, 0), (1.00001, 1)):
            current_ma = (v.spring_rate_n_per_m * place_m + factor * pull_n) / (
                v.diaphragm_area_m2 * v.pressure_gain_pa_per_ma
            )
            assert valve.step(plant, rested, current_ma, 1e-6).stem.slips == slips


def test_the_work_of_friction_by_place_is_the_integral_of_the_waves() -> None:
    v = BY_PLACE.valve
    gain = v.diaphragm_area_m2 * v.pressure_gain_pa_per_ma
    plant = replace(BY_PLACE, valve=replace(v, viscous_friction_n_s_per_m=0.0))
    for current_ma, direction in ((19.0, 1.0), (4.0, -1.0)):
        begun = replace(plant, valve=replace(plant.valve, initial_position_m=0.07 - 0.01 * direction))
        start = valve.initial_state(begun, 0)
        moved = valve.step(plant, start, current_ma, 5e-3)
        x0, x1, speed = start.stem.position_m, moved.stem.position_m, moved.stem.velocity_m_per_s
        assert direction * (x1 - x0) > 2e-3
        places = np.linspace(x0, x1, 20001)
        middle = 0.5 * (places[1:] + places[:-1])
        size, one_way = np.array([waves(x) for x in middle]).T
        friction_n = v.coulomb_friction_n * (1.0 + size) + direction * v.static_friction_n * one_way
        driven_j = gain * current_ma * (x1 - x0) - 0.5 * v.spring_rate_n_per_m * (x1 * x1 - x0 * x0)
        work_j = float(friction_n.mean()) * abs(x1 - x0)
        assert 0.5 * v.mass_kg * speed * speed == pytest.approx(driven_j - work_j, rel=2e-3)
