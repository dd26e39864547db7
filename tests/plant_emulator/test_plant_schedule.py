"""Changes at given instants: each acts at its own, and a mistake is refused by name."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest

from plant_emulator import valve
from plant_emulator.device import initial_device, publish
from plant_emulator.presets import overridden, plant_settings
from positioner.errors import ConfigurationError
from positioner.inputs.toml_reader import tables
from positioner.wire.codec import make_codec
from positioner.wire.messages import StemPosition
from positioner.wire.settings import WireSettings

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings

GAIN_PA_PER_MA = 5171.06775


def plant_with(*changes: tuple[float, str, float], **more: Any) -> PlantSettings:
    schedule = [{"at_s": at_s, "key": key, "value": value} for at_s, key, value in changes]
    return plant_settings("noise-free", {"schedule": schedule, **more})


@pytest.mark.parametrize("pieces", [1, 3, 10])
def test_a_supply_that_drops_vents_the_chamber_from_its_instant_on(pieces: int) -> None:
    plant = plant_with((0.3, "actuator.supply_pa", 40e3), actuator={"vent_time_constant_s": 0.2})
    state = valve.held_state(plant, 0, 12.0)
    for _ in range(pieces):
        state = valve.step(plant, state, 12.0, 0.5 / pieces)
    full_pa = 12.0 * GAIN_PA_PER_MA
    assert state.actuator.pressure_pa == pytest.approx(40e3 + (full_pa - 40e3) * math.exp(-1.0), rel=1e-12)


def test_sudden_sticking_holds_a_stem_that_would_have_moved() -> None:
    sticking = plant_with((1.0, "valve.static_friction_n", 5000.0))
    free = plant_with((3.0, "valve.static_friction_n", 5000.0))
    ends = []
    for plant in (sticking, free):
        state = valve.step(plant, valve.initial_state(plant, 0), 2.0, 1.5)
        state = valve.step(plant, state, 12.0, 1.0)
        ends.append((state.stem.slips, state.packing.static_n))
    assert ends == [(0, 5000.0), (1, 1707.7)]


def test_a_friction_that_falls_below_the_pull_lets_the_stem_slip_at_that_instant() -> None:
    plant = plant_with((0.2, "valve.static_friction_n", 1500.0))
    current_ma = (52538.0 * 0.01 + 1600.0) / 333.637
    state = valve.step(plant, valve.initial_state(plant, 0), current_ma, 0.2)
    assert state.stem.slips == 0
    assert valve.step(plant, state, current_ma, 1e-6).stem.slips == 1


def test_a_zero_that_shifts_shows_in_the_readings_and_not_in_the_stem() -> None:
    plant = plant_with((0.05, "sensor.zero_m", 0.003))
    state = valve.initial_state(plant, 0)
    shown = []
    for _ in range(10):
        state = valve.step(plant, state, 2.0, 0.01)
        shown.append(valve.measure(plant, state)[1])
    assert shown == pytest.approx([0.01] * 4 + [0.013] * 6, abs=1e-15)
    assert state.stem.position_m == 0.01


def test_a_sensor_lag_may_come_later() -> None:
    plant = plant_with((1.0, "sensor.time_constant_s", 0.1))
    state = valve.step(plant, valve.initial_state(plant, 0), 12.0, 1.0 - 1e-3)
    assert valve.measure(plant, state)[1] == state.stem.position_m
    moving = valve.step(plant, state, 20.0, 0.02)
    assert valve.measure(plant, moving)[1] < moving.stem.position_m - 1e-3


def test_changes_add_up_in_the_order_of_their_instants() -> None:
    plant = plant_with(
        (0.3, "actuator.offset_ma", 0.0), (0.1, "actuator.offset_ma", 1.0), (0.2, "actuator.supply_pa", 50e3)
    )
    state = valve.held_state(plant, 0, 9.0)
    found = []
    for _ in range(4):
        state = valve.step(plant, state, 9.0, 0.1)
        found.append(state.actuator.pressure_pa)
    assert found == pytest.approx([9.0 * GAIN_PA_PER_MA, 10.0 * GAIN_PA_PER_MA, 50e3, 9.0 * GAIN_PA_PER_MA], rel=1e-12)


def test_the_node_sends_the_shifted_reading() -> None:
    plant = plant_with((0.0, "sensor.zero_m", 0.002))
    codec = make_codec(WireSettings(), span_m=0.127)
    _, frames = publish(codec, plant, initial_device(plant, 0))
    (message,) = [m for m, _ in map(codec.decode, frames) if isinstance(m, StemPosition)]
    assert message.position_m == pytest.approx(0.012, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ('at_s = 1.0\nkey = "valve.travel_max_m"\nvalue = 0.1', "key 'valve.travel_max_m' cannot change"),
        ('at_s = 1.0\nkey = "deadman_s"\nvalue = 0.1', "key 'deadman_s' cannot change"),
        ('at_s = 1.0\nkey = "valve.static_friction"\nvalue = 0.1', r"did you mean 'static_friction_n'\?"),
        ('at_s = 1.0\nkey = "valve.static_friction_n"\nvalue = 1e6', "at 1 s: .*must be less than or equal to 100000"),
        ('at_s = 1.0\nkey = "valve.static_friction_n"\nvalue = 9.0', "coulomb_friction_n must not be above"),
        ('at_s = -1.0\nkey = "sensor.zero_m"\nvalue = 0.0', "must be greater than or equal to 0"),
        ('at_s = 1.0\nkey = "sensor.zero_m"', "required and missing"),
    ],
)
def test_a_change_that_cannot_be_is_refused_by_name(change: str, message: str) -> None:
    text = f'preset = "paper"\n\n[[schedule]]\n{change}\n'
    with pytest.raises(ConfigurationError, match=message):
        overridden(tables(text, "plant.toml"), {}, "plant.toml", text)
