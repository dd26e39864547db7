"""Scenario files: the packaged ones load, and every mistake has its line."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from plant_emulator.presets import plant_settings
from positioner.bench.scenario import load_scenario, parse_scenario, scenario_names
from positioner.errors import ConfigurationError, UsageError
from positioner.inputs.toml_reader import build
from positioner.valve.parameters import ValveParameters

if TYPE_CHECKING:
    from pathlib import Path

PACKAGED = (
    "friction+20",
    "frictionless",
    "noise-free",
    "paper-1",
    "paper-2",
    "paper-3",
    "paper-4",
    "paper-5",
    "paper-valve",
    "real-valve",
    "spring-20",
    "stochastic",
)

NOISE_FREE = ("frictionless", "noise-free")

SHORT = """
name = "short"
title = "a short one"
setpoints_mm = [70, 80.5]
dwell_s = 0.3
"""


def test_the_packaged_scenarios_are_the_documented_ones() -> None:
    assert scenario_names() == PACKAGED


@pytest.mark.parametrize("name", PACKAGED)
def test_every_packaged_scenario_loads_under_its_own_name(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert len(scenario.description) > 40


@pytest.mark.parametrize("name", PACKAGED)
def test_the_emulator_and_the_model_accept_what_every_packaged_scenario_passes_on(name: str) -> None:
    scenario = load_scenario(name)
    plant = plant_settings(overrides=scenario.plant)
    build({"id": "bench", **scenario.valve}, ValveParameters, name)
    noises = {"real-valve": (0.0, 0.0005), **dict.fromkeys(NOISE_FREE, (0.0, 0.0))}
    assert (plant.sensor.noise_of_reading, plant.sensor.noise_of_span) == noises.get(name, (0.02, 0.0))


def test_the_packaged_mismatches_are_those_of_their_names() -> None:
    paper = plant_settings().valve
    spring = plant_settings(overrides=load_scenario("spring-20").plant).valve
    assert spring.spring_rate_n_per_m == pytest.approx(0.8 * paper.spring_rate_n_per_m)
    assert replace(spring, spring_rate_n_per_m=paper.spring_rate_n_per_m) == paper
    friction = plant_settings(overrides=load_scenario("friction+20").plant).valve
    assert friction.static_friction_n == pytest.approx(1.2 * paper.static_friction_n)
    assert friction.coulomb_friction_n == pytest.approx(1.2 * paper.coulomb_friction_n)
    assert plant_settings(overrides=load_scenario("stochastic").plant).stochastic.friction_fraction == 0.1
    assert plant_settings(overrides=load_scenario("frictionless").plant).valve.static_friction_n == 0.0


def test_the_default_scenario_visits_three_setpoints_three_times_in_10_8_seconds() -> None:
    scenario = load_scenario("paper-valve")
    assert scenario.visited_mm == (73.0, 87.0, 80.0) * 3
    assert scenario.duration_s == pytest.approx(10.8)
    assert len(scenario.dwell_edges_s) == 10
    assert scenario.samples_per_dwell == 1200
    assert scenario.samples_per_setpoint == 10


@pytest.mark.parametrize("name", NOISE_FREE)
def test_a_scenario_at_a_tenth_of_a_millisecond_stays_cheap(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.sample_period_s == 1e-4
    assert 2_000 <= scenario.samples_per_dwell * len(scenario.visited_mm) <= 10_000


def test_a_missing_key_has_its_default() -> None:
    scenario = parse_scenario(SHORT, "short.toml")
    assert (scenario.law, scenario.visits, scenario.sample_period_s, scenario.setpoint_period_s) == (
        "paper",
        1,
        1e-3,
        0.01,
    )
    assert scenario.table_from_s is None
    assert scenario.visited_mm == (70.0, 80.5)


def test_the_tables_for_the_emulator_and_the_daemon_pass_through_unread() -> None:
    text = SHORT + "[plant]\npreset = 'x'\n[plant.any.thing]\na = [1, 'b']\n[valve]\nc = 2.5\n[control]\nd = true\n"
    scenario = parse_scenario(text, "short.toml")
    assert scenario.plant == {"preset": "x", "any": {"thing": {"a": [1, "b"]}}}
    assert (scenario.valve, scenario.control) == ({"c": 2.5}, {"d": True})


def test_a_scenario_is_loaded_from_a_path(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(SHORT, encoding="utf-8")
    assert load_scenario(str(path)) == parse_scenario(SHORT, "mine.toml")


@pytest.mark.parametrize("missing", ["not-there.toml", "./paper-valve"])
def test_a_path_is_never_taken_for_a_name(missing: str) -> None:
    with pytest.raises(ConfigurationError, match="cannot be read: No such file"):
        load_scenario(missing)


def test_an_unknown_name_is_answered_with_the_nearest_and_all_known_ones() -> None:
    with pytest.raises(UsageError) as caught:
        load_scenario("paper-vavle")
    assert "scenario 'paper-vavle' is unknown; did you mean 'paper-valve'?" in str(caught.value)
    assert all(name in str(caught.value) for name in PACKAGED)
    with pytest.raises(UsageError) as caught:
        load_scenario("qqq")
    assert "did you mean" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ("dwell_s = 0.3", "dwell_s = 0.305"),
            "short.toml: line 5: dwell_s = 0.305: must be a whole multiple of setpoint_period_s = 0.01",
        ),
        (("dwell_s = 0.3", "dwell_s = 0.004"), "line 5: dwell_s = 0.004: must be a whole multiple"),
        (
            ("dwell_s = 0.3", "dwell_s = 0.3\nsample_period_s = 0.003"),
            "setpoint_period_s = 0.01: must be a whole multiple of sample_period_s = 0.003",
        ),
        (("dwell_s = 0.3", "dwell_s = 0.0"), "line 5: dwell_s = 0.0: must be greater than 0"),
        (("dwell_s = 0.3", "dwell_s = inf"), "dwell_s"),
        (("dwell_s = 0.3", "dwel_s = 0.3"), "line 5: dwel_s: unknown key; did you mean 'dwell_s'?"),
        (("[70, 80.5]", "[]"), "line 4: setpoints_mm"),
        (("[70, 80.5]", "[70, -1]"), "line 4: setpoints_mm = -1: must be greater than or equal to 0"),
        (("[70, 80.5]", "[70, nan]"), "setpoints_mm"),
        (("dwell_s = 0.3", "dwell_s = 0.3\nvisits = 0"), "line 6: visits = 0: must be greater than or equal to 1"),
        (("dwell_s = 0.3", "dwell_s = 0.3\nseed = -1"), "line 6: seed = -1"),
    ],
)
def test_a_mistake_is_named_with_its_line_and_the_right_values(change: tuple[str, str], message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        parse_scenario(SHORT.replace(*change), "short.toml")
    assert message in str(caught.value)


@pytest.mark.parametrize("sample_period_s", [0.0002, 0.0005, 0.001, 0.002, 0.005, 0.01])
def test_sample_periods_that_divide_are_accepted_in_spite_of_binary_fractions(sample_period_s: float) -> None:
    assert parse_scenario(SHORT + f"sample_period_s = {sample_period_s}\n", "short.toml").samples_per_setpoint >= 1


def test_more_samples_per_setpoint_than_the_sockets_hold_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="must be at most 60 sample periods"):
        parse_scenario(SHORT + "sample_period_s = 0.0001\n", "short.toml")


@pytest.mark.parametrize("dwell_s", [0.3, 1.1, 1.2, 4.35])
def test_decimal_dwells_that_are_multiples_are_accepted(dwell_s: float) -> None:
    # 1.1 / 0.01 is 110.00000000000001
    scenario = parse_scenario(SHORT.replace("dwell_s = 0.3", f"dwell_s = {dwell_s}"), "short.toml")
    assert scenario.samples_per_dwell == round(dwell_s * 1000)


@pytest.mark.parametrize(("key", "value"), [("sample_period_s", "0.002"), ("law", '"pi"')])
def test_a_key_of_control_that_the_scenario_has_itself_is_refused(key: str, value: str) -> None:
    text = f"name='s'\ntitle='t'\nsetpoints_mm=[73]\ndwell_s=1\n[control]\n{key} = {value}\n"
    with pytest.raises(ConfigurationError, match=rf"control\.{key} = .*: the scenario itself has {key} = "):
        parse_scenario(text, "s.toml")
