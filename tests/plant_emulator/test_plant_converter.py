"""The I/P converter: offset, hysteresis, dead band and supply, each against what it should pass."""

from __future__ import annotations

import pytest

from plant_emulator import valve
from plant_emulator.converter import Converted, converted
from plant_emulator.parameters import ActuatorSettings
from plant_emulator.presets import plant_settings

GAIN_PA_PER_MA = 5171.06775


def passed(settings: ActuatorSettings, currents_ma: list[float]) -> list[float]:
    state, found = Converted(currents_ma[0], currents_ma[0]), []
    for current_ma in currents_ma:
        state = converted(settings, state, current_ma)
        found.append(state.passed_ma)
    return found


def test_hysteresis_lags_by_half_its_width_and_rests_for_all_of_it_at_a_turn() -> None:
    settings = ActuatorSettings(hysteresis_ma=0.5)
    assert passed(settings, [8.0, 8.25, 9.0, 8.75, 8.5, 8.0, 8.25]) == [8.0, 8.0, 8.75, 8.75, 8.75, 8.25, 8.25]


def test_a_dead_band_passes_the_current_once_it_has_changed_by_the_band() -> None:
    settings = ActuatorSettings(dead_band_ma=0.25)
    assert passed(settings, [8.0, 8.125, 8.1875, 8.25, 8.0625, 8.0, 8.5]) == [8.0, 8.0, 8.0, 8.25, 8.25, 8.0, 8.5]


def test_the_offset_is_added_and_the_hysteresis_comes_before_the_dead_band() -> None:
    settings = ActuatorSettings(offset_ma=0.5, hysteresis_ma=0.5, dead_band_ma=0.5)
    assert passed(settings, [8.0, 8.5, 9.0, 9.25]) == [8.0, 8.75, 9.25, 9.25]


def test_offset_and_supply_shape_the_pressure() -> None:
    plant = plant_settings("paper", "actuator.offset_ma = -0.5\nactuator.supply_pa = 60e3")
    state = valve.initial_state(plant, 0)
    for current_ma, pressure_pa in ((10.0, 9.5 * GAIN_PA_PER_MA), (20.0, 60e3), (0.25, 0.0)):
        state = valve.step(plant, state, current_ma, 0.01)
        assert state.actuator.pressure_pa == pytest.approx(pressure_pa, rel=1e-14)
        held = valve.held_state(plant, 0, current_ma)
        assert held.actuator.pressure_pa == pytest.approx(pressure_pa, rel=1e-14)


def test_a_supply_that_is_too_low_bounds_the_lagging_pressure_too() -> None:
    plant = plant_settings("paper", "actuator.supply_pa = 60e3\nactuator.fill_time_constant_s = 0.02")
    state = valve.step(plant, valve.initial_state(plant, 0), 20.0, 1.0)
    assert state.actuator.pressure_pa == pytest.approx(60e3, rel=1e-12)
