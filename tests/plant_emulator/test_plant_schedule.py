"""Changes at given instants: each acts at its own, and a mistake is refused by name."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest

from plant_emulator import valve
from plant_emulator.device import initial_device, publish
from plant_emulator.presets import overridden, plant_settings
from plant_emulator.schedule import acting, begun
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
        ('at_s = 1.0\nkey = "sensor.zero_m"', "change of sensor.zero_m: give either its value or a factor"),
        ('at_s = 1.0\nkey = "sensor.zero_m"\nvalue = 0.0\nfactor = 2.0', "give either its value or a factor"),
        ('at_s = 1.0\nkey = "valve.spring_rate_n_per_m"\nfactor = 0.0', "at 1 s: .*greater than or equal to 100"),
        (
            "".join(
                f'key = "sensor.zero_m"\n{each}'
                for each in ("at_s=1.0\nover_s=5.0\nvalue=0.1\n[[schedule]]\n", "at_s=5.9\nvalue=0.0")
            ),
            "schedule at 5.9 s: sensor.zero_m still changes until 6 s",
        ),
    ],
)
def test_a_change_that_cannot_be_is_refused_by_name(change: str, message: str) -> None:
    text = f'preset = "paper"\n\n[[schedule]]\n{change}\n'
    with pytest.raises(ConfigurationError, match=message):
        overridden(tables(text, "plant.toml"), {}, "plant.toml", text)


def test_a_factor_multiplies_the_value_that_acts_before() -> None:
    schedule = [
        {"at_s": 0.1, "key": "valve.spring_rate_n_per_m", "factor": 0.9},
        {"at_s": 0.2, "key": "valve.spring_rate_n_per_m", "value": 50_000.0},
        {"at_s": 0.3, "key": "valve.spring_rate_n_per_m", "factor": 1.1},
    ]
    plant = plant_settings("noise-free", {"schedule": schedule})
    rates = [acting(plant, at_s).valve.spring_rate_n_per_m for at_s in (0.0, 0.15, 0.25, 0.35)]
    assert rates == pytest.approx([52_538.0, 47_284.2, 50_000.0, 55_000.0], rel=1e-12)


@pytest.mark.parametrize("pieces", [1, 7, 1000])
def test_a_drift_follows_its_line_within_half_a_step_however_time_is_divided(pieces: int) -> None:
    drift = {"at_s": 1.0, "key": "actuator.offset_ma", "value": 0.3, "over_s": 2.0}
    plant = plant_settings("noise-free", {"schedule": [drift]})
    for end_s in (0.5, 1.0, 1.234, 2.0, 2.77, 3.0, 5.0):
        state = valve.held_state(plant, 0, 9.0)
        for _ in range(pieces):
            state = valve.step(plant, state, 9.0, end_s / pieces)
        offset_ma = state.actuator.pressure_pa / GAIN_PA_PER_MA - 9.0
        line_ma = 0.3 * min(max((end_s - 1.0) / 2.0, 0.0), 1.0)
        assert offset_ma == pytest.approx(line_ma, abs=0.5001 * 0.3 / 100)
    assert offset_ma == pytest.approx(0.3, abs=1e-12)


def test_a_gain_of_the_converter_that_drifts_scales_the_pressure() -> None:
    drift = {"at_s": 0.1, "key": "valve.pressure_gain_pa_per_ma", "factor": 0.95, "over_s": 0.2}
    plant = plant_settings("noise-free", {"schedule": [drift]})
    state = valve.step(plant, valve.held_state(plant, 0, 9.0), 9.0, 0.4)
    assert state.actuator.pressure_pa == pytest.approx(0.95 * 9.0 * GAIN_PA_PER_MA, rel=1e-12)


@pytest.mark.parametrize(("factor", "slips"), [(1.3, 0), (0.999, 1)])
def test_a_friction_factor_scales_both_frictions_at_its_instant(factor: float, slips: int) -> None:
    plant = plant_with((1.0, "packing.friction_factor", factor))
    current_ma = (52538.0 * 0.01 + 1707.0) / 333.637
    state = valve.step(plant, valve.initial_state(plant, 0), current_ma, 1.0 + 1e-6)
    assert state.stem.slips == slips
    assert state.packing.static_n == pytest.approx(factor * 1707.7, rel=1e-12)
    assert state.packing.coulomb_n == pytest.approx(factor * 1423.0, rel=1e-12)


def test_a_sliding_stem_that_sticks_fast_stands_at_once() -> None:
    plant = plant_with((0.3, "packing.friction_factor", 100.0))
    free = plant_settings("noise-free")
    sliding = stuck = valve.initial_state(free, 0)
    for number in range(200):
        current_ma = 7.0 + 0.01 * number
        sliding, stuck = (valve.step(each, s, current_ma, 0.002) for each, s in ((free, sliding), (plant, stuck)))
        if number == 149:
            at_m, speed = sliding.stem.position_m, sliding.stem.velocity_m_per_s
    # 0.5 m v² of 0.03 m/s is the work of 142 kN over 5 nm
    assert speed > 0.01
    assert stuck.stem.is_at_rest
    assert stuck.stem.position_m == pytest.approx(at_m, abs=1e-5)
    assert sliding.stem.position_m > at_m + 1e-3


def moved(plant: PlantSettings, moves: int, seed: int = 0) -> list[float]:
    """Return the factor of the friction after each move: a second each."""
    state, factors = valve.initial_state(plant, seed), []
    for number in range(moves):
        state = valve.step(plant, state, 18.0 if number % 2 == 0 else 6.0, 1.0)
        assert state.stem.stops == number + 1
        factors.append(state.packing.static_n / 1707.7)
    return factors


@pytest.mark.parametrize("drift", [0.001, -0.001])
def test_a_drift_by_moves_begins_at_its_instant_and_rises_or_falls_by_10_percent_in_100_moves(drift: float) -> None:
    plant = plant_with((29.5, "packing.drift_per_move", drift), packing={"drift_per_move": 0.0})
    factors = moved(plant, 130)
    assert factors == pytest.approx([1.0 + drift * max(number - 30, 0) for number in range(1, 131)], rel=1e-12)


def test_a_drift_that_ends_stays_where_it_is_and_another_goes_on_from_there() -> None:
    plant = plant_with(
        (9.5, "packing.drift_per_move", 0.0),
        (20.5, "packing.drift_per_hour", 36.0),
        (20.5, "sensor.zero_m", 0.001),
        packing={"drift_per_move": 0.01},
    )
    factors = moved(plant, 25)
    assert factors[9:20] == pytest.approx([1.1] * 11, rel=1e-12)
    # 36/h is 1 % in a second, counted from its instant; it shows at the stops, soon after the edge of each second
    assert factors[20] == pytest.approx(1.1, rel=1e-12)
    assert factors[21] == pytest.approx(1.105, abs=0.001)
    assert factors[24] - factors[21] == pytest.approx(0.03, abs=1e-4)


def test_each_change_is_reported_once_with_its_values_however_time_is_divided() -> None:
    schedule = [
        {"at_s": 1.0, "key": "packing.friction_factor", "value": 2.0},
        {"at_s": 2.0, "key": "packing.friction_factor", "factor": 0.5, "over_s": 3.0},
    ]
    plant = plant_settings("noise-free", {"schedule": schedule})
    lines = [line for number in range(300) for line in begun(plant, 0.01 * number, 0.01 * (number + 1))]
    assert lines == [
        "at 1 s: packing.friction_factor from 1 to 2",
        "at 2 s: packing.friction_factor from 2 to 1, over 3 s",
    ]
