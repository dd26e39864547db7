"""Presets, overrides, limits, and the messages for mistakes."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest

from plant_emulator import valve
from plant_emulator.parameters import FailPosition, PlantSettings
from plant_emulator.presets import overridden, plant_settings, preset_names, preset_summary
from positioner.errors import ConfigurationError
from positioner.inputs.toml_reader import tables

PAPER = plant_settings("paper")


def plant_of(text: str) -> PlantSettings:
    return overridden(tables(text, "plant.toml"), {}, "plant.toml", text)


def test_the_presets_are_these_and_all_can_be_read() -> None:
    assert preset_names() == (
        "ageing", "creeping", "failing", "friction+10", "friction+20", "friction-10", "friction-20",
        "friction-by-place", "frictionless", "graphite", "low-supply", "lugre", "lugre-graphite", "mass-flow",
        "mass-flow-booster", "mass-flow-lugre", "maxwell-slip", "noise-free", "paper", "pneumatics", "process",
        "real-valve", "seated", "spring+20", "spring-10", "spring-20", "stochastic", "wearing",
    )  # fmt: skip
    for name in preset_names():
        assert plant_settings(name).preset == name
        assert preset_summary(name).endswith(".")


def test_the_paper_preset_is_table_3_and_equation_10() -> None:
    v = PAPER.valve
    assert (v.mass_kg, v.diaphragm_area_m2, v.spring_rate_n_per_m) == (1.361, 0.06452, 52538.0)
    assert (v.static_friction_n, v.coulomb_friction_n, v.viscous_friction_n_s_per_m) == (1707.7, 1423.0, 612.9)
    assert (v.stribeck_velocity_m_per_s, v.stick_velocity_m_per_s) == (0.000254, 0.0001524)
    assert v.pressure_gain_pa_per_ma == pytest.approx(0.75 * 6894.757, rel=1e-15)
    assert (v.bench_set_n, PAPER.sensor.noise_of_reading, PAPER.sensor.noise_hold_s) == (0.0, 0.02, 0.0)


@pytest.mark.parametrize(
    ("name", "spring", "friction"),
    [
        ("spring+20", 1.2, 1.0),
        ("spring-10", 0.9, 1.0),
        ("spring-20", 0.8, 1.0),
        ("friction+10", 1.0, 1.1),
        ("friction+20", 1.0, 1.2),
        ("friction-10", 1.0, 0.9),
        ("friction-20", 1.0, 0.8),
    ],
)
def test_a_mismatched_preset_differs_from_the_paper_in_the_named_parameters_only(
    name: str, spring: float, friction: float
) -> None:
    v = PAPER.valve
    settings = plant_settings(name)
    scaled = {
        "spring_rate_n_per_m": spring * v.spring_rate_n_per_m,
        "static_friction_n": friction * v.static_friction_n,
        "coulomb_friction_n": friction * v.coulomb_friction_n,
        "viscous_friction_n_s_per_m": friction * v.viscous_friction_n_s_per_m,
    }
    for key, value in scaled.items():
        assert getattr(settings.valve, key) == pytest.approx(value, rel=1e-12)
    unscaled = replace(settings.valve, **{key: getattr(v, key) for key in scaled})
    assert replace(settings, preset="paper", valve=unscaled) == PAPER


def test_the_graphite_preset_is_slow_and_440_newtons_per_milliampere() -> None:
    settings = plant_settings("graphite")
    assert settings.valve.diaphragm_area_m2 * settings.valve.pressure_gain_pa_per_ma == pytest.approx(440.0)
    assert settings.valve.span_m == 0.025
    assert settings.actuator.fill_time_constant_s == 0.1


def test_the_real_valve_is_the_papers_with_a_lag_of_50_ms_a_better_sensor_and_measured_pressure() -> None:
    settings = plant_settings("real-valve")
    assert settings.valve == PAPER.valve
    assert (settings.actuator.fill_time_constant_s, settings.actuator.vent_time_constant_s) == (0.05, 0.05)
    assert (settings.sensor.noise_of_reading, settings.sensor.noise_of_span) == (0.0, 0.0005)
    assert settings.sensor.reports_pressure


@pytest.mark.parametrize(
    ("name", "tables"),
    [
        ("pneumatics", {"actuator", "sensor"}),
        ("process", {"process"}),
        ("ageing", {"packing"}),
        ("wearing", {"packing"}),
        ("creeping", {"packing"}),
        ("low-supply", {"actuator"}),
        ("failing", {"schedule"}),
    ],
)
def test_a_variant_of_the_real_valve_differs_in_the_named_tables_only(name: str, tables: set[str]) -> None:
    real, variant = plant_settings("real-valve"), plant_settings(name)
    found = {each.name for each in fields(PlantSettings) if getattr(real, each.name) != getattr(variant, each.name)}
    assert found == {"preset", *tables}


def test_a_low_supply_ends_the_reach_where_17_ma_end_it() -> None:
    low, v = plant_settings("low-supply"), PAPER.valve
    state = valve.step(low, valve.initial_state(low, 0), 20.0, 5.0)
    assert state.actuator.pressure_pa == pytest.approx(17.0 * v.pressure_gain_pa_per_ma, abs=0.2)
    # the lag leaves a little speed to the end, where friction rises to F_s within V_s
    push_n = 17.0 * v.pressure_gain_pa_per_ma * v.diaphragm_area_m2
    slid_m = (push_n - v.coulomb_friction_n) / v.spring_rate_n_per_m
    assert state.stem.position_m == pytest.approx(slid_m, abs=1e-4)


@pytest.mark.parametrize("rest_s", [0.1, 0.5, 2.0])
def test_a_creeping_contact_holds_more_after_a_rest(rest_s: float) -> None:
    creeping, v = plant_settings("creeping", {"actuator": lag_free()}), PAPER.valve
    held_n = v.static_friction_n * (1.0 + 0.2 * (1.0 - math.exp(-rest_s / 0.5)))
    balance_n = v.spring_rate_n_per_m * v.initial_position_m
    for more, slips in ((0.999, 0), (1.001, 1)):
        rested = valve.step(creeping, valve.initial_state(creeping, 0), balance_n / gain(creeping), rest_s)
        state = valve.step(creeping, rested, (balance_n + more * held_n) / gain(creeping), 1e-6)
        assert state.stem.slips == slips


def test_the_failing_valve_has_each_fault_from_its_instant_on() -> None:
    failing, v = plant_settings("failing", {"actuator": lag_free(), "sensor": {"noise_of_span": 0.0}}), PAPER.valve
    state = valve.held_state(failing, 0, 2.0)
    found = []
    for _ in range(5):
        state = valve.step(failing, state, 2.0, 59.0)
        shown_m = valve.measure(failing, state)[1] - state.stem.position_m
        full = valve.step(failing, state, 20.0, 1.0)
        found.append((shown_m, full.actuator.pressure_pa / v.pressure_gain_pa_per_ma, full.stem.position_m > 0.06))
        state = valve.step(failing, state, 2.0, 1.0)
    low_ma = 80e3 / v.pressure_gain_pa_per_ma
    expected = [
        (0.0, 20.0, True),
        (0.002, 20.0, True),
        (0.002, 19.5, True),
        (0.002, low_ma, True),
        (0.002, low_ma, False),
    ]
    for each, wanted in zip(found, expected, strict=True):
        assert each == pytest.approx(wanted, abs=1e-9)


def lag_free() -> dict[str, float]:
    return {"fill_time_constant_s": 0.0, "vent_time_constant_s": 0.0}


def gain(settings: PlantSettings) -> float:
    return settings.valve.pressure_gain_pa_per_ma * settings.valve.diaphragm_area_m2


def test_the_seated_valve_closes_inside_the_loop_and_opens_where_the_spring_and_static_friction_are_overcome() -> None:
    seated = plant_settings("seated")
    # so slowly that friction is F_s up to the stop
    closes_ma, opens_ma = (3000.0 - 942.0) / 440.0, (3000.0 + 942.0) / 440.0
    assert 4.0 < closes_ma < opens_ma < 20.0
    state = valve.step(seated, valve.initial_state(seated, 0), closes_ma + 0.02, 60.0)
    assert state.stem.position_m == pytest.approx(0.02 * 440.0 / 206941.0, rel=0.02)
    state = valve.step(seated, state, closes_ma - 0.01, 60.0)
    assert state.stem.position_m == 0.0
    state = valve.step(seated, state, 4.0, 10.0)
    assert state.stem.position_m == 0.0
    assert valve.step(seated, state, opens_ma - 1e-6, 10.0).stem.position_m == 0.0
    opened = valve.step(seated, state, opens_ma + 0.02, 60.0)
    assert opened.stem.position_m == pytest.approx(0.02 * 440.0 / 206941.0, rel=0.02)


def test_a_plant_file_replaces_values_of_its_preset() -> None:
    settings = plant_of(
        'preset = "spring-20"\nfail_position = "hold"\n\n[valve]\nmass_kg = 2.0\n\n[sensor]\nresolution_m = 1e-5\n'
    )
    assert settings.preset == "spring-20"
    assert (settings.valve.mass_kg, settings.valve.spring_rate_n_per_m) == (2.0, 42030.4)
    assert (settings.sensor.resolution_m, settings.sensor.noise_of_reading) == (1e-5, 0.02)
    assert settings.fail_position is FailPosition.HOLD


def test_the_example_shows_every_key_of_its_tables_but_three_of_the_sensor() -> None:
    text = (Path(__file__).parents[2] / "examples" / "plant.toml").read_text(encoding="utf-8")
    settings, shown = plant_of(text), tables(text, "plant.toml")
    for table in ("friction", "actuator", "chamber", "process", "packing"):
        assert set(shown[table]) == {each.name for each in fields(getattr(settings, table))}
    missing = {each.name for each in fields(settings.sensor)} - set(shown["sensor"])
    assert missing == {"noise_of_reading", "noise_hold_s", "reports_pressure"}
    assert [change.key for change in settings.schedule] == [
        "sensor.zero_m", "actuator.offset_ma", "actuator.supply_pa", "valve.spring_rate_n_per_m",
        "actuator.vent_time_constant_s", "packing.drift_per_move", "packing.friction_factor",
    ]  # fmt: skip


def test_a_plant_file_without_a_preset_stands_alone() -> None:
    with pytest.raises(ConfigurationError, match=r"plant\.toml: .*valve.*required and missing"):
        plant_of("deadman_s = 0.2\n")


def test_overrides_may_be_text_or_tables() -> None:
    assert plant_settings("paper", "valve.mass_kg = 2.0") == plant_settings("paper", {"valve": {"mass_kg": 2.0}})


def test_an_unknown_preset_is_refused_with_the_known_ones() -> None:
    with pytest.raises(
        ConfigurationError, match=r"line 2: preset = 'papr': is no preset; did you mean 'paper'\? known: ."
    ):
        plant_of('# mine\npreset = "papr"\n')


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"valve": {"mass_kg": 1361.0}}, r"valve\.mass_kg = 1361.0: must be less than or equal to 200"),
        ({"valve": {"mass": 1.0}}, r"valve\.mass: unknown key; did you mean 'mass_kg'\?"),
        ({"valve": {"mass_kg": "1"}}, r"valve\.mass_kg = '1': must be a valid number"),
        ({"valve": {"mass_kg": float("inf")}}, r"valve\.mass_kg"),
        ({"valve": {"coulomb_friction_n": 1800.0}}, "coulomb_friction_n must not be above static_friction_n"),
        ({"valve": {"travel_max_m": 0.0}}, "travel_min_m must be below travel_max_m"),
        ({"valve": {"initial_position_m": 0.2}}, "initial_position_m must be from travel_min_m to travel_max_m"),
        ({"actuator": {"dead_time_s": -0.1}}, r"actuator\.dead_time_s = -0.1: must be greater than or equal to 0"),
        ({"sensor": {"noise_of_reading": 2.0}}, r"sensor\.noise_of_reading = 2.0: must be less than or equal to 1"),
        ({"stochastic": {"friction_fraction": 1.0}}, r"friction_fraction = 1.0: must be less than or equal to 0\.9"),
        ({"fail_position": "ajar"}, "fail_position = 'ajar': must be 'close', 'open', 'hold' or 'current'"),
        ({"deadman_s": 0.0}, "deadman_s = 0.0: must be greater than or equal to 0.001"),
    ],
)
def test_a_value_out_of_its_limits_is_refused_by_name(overrides: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        plant_settings("paper", overrides)
