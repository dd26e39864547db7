"""Scenarios that a bench refuses, and the valve whose parameters its controller has."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from plant_emulator.presets import plant_settings, preset_names, root_preset
from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.playable import check_playable, restartable_mm
from positioner.bench.scenario import Scenario, load_scenario, scenario_names
from positioner.cli.main import main
from positioner.errors import ConfigurationError, ExitCode
from positioner.studies.direct import play_directly
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters
from positioner.valve.presets import PRESETS

if TYPE_CHECKING:
    from pathlib import Path

SCENARIO = Scenario(name="s", title="t", law="nmpc", setpoints_mm=(73.0,), dwell_s=0.1)
GRAPHITE = replace(SCENARIO, setpoints_mm=(20.0, 16.0), plant={"preset": "graphite"})


def refused(scenario: Scenario) -> list[str]:
    with pytest.raises(ConfigurationError) as caught:
        check_playable(scenario, configure(scenario))
    for play in (run_in_process, lambda same: list(play_directly(same))):
        with pytest.raises(ConfigurationError) as again:
            play(scenario)
        assert str(again.value) == str(caught.value)
    return [str(problem) for problem in caught.value.problems]


@pytest.mark.parametrize("name", preset_names())
def test_without_parameters_the_controller_has_those_of_the_valve_that_the_plant_is_a_variant_of(name: str) -> None:
    own = root_preset(name)
    assert own in {name, "paper", "graphite", "real-valve"}
    found = configure(replace(SCENARIO, plant={"preset": name}))
    actuator = ActuatorParameters(**PRESETS[own]["actuator"])
    known: dict[str, Any] = {}
    if name == "seated":
        known = {"bench_set_n": 3000.0}
    if name in {"mass-flow", "mass-flow-lugre"}:  # no lag that could be told
        actuator = ActuatorParameters()
    if name == "pneumatics":
        slew_ma_per_s = 400e3 / 5171.06775
        actuator = ActuatorParameters(
            fill_time_constant_s=0.05, vent_time_constant_s=0.03, dead_time_s=0.002, slew_ma_per_s=slew_ma_per_s,
            converter_time_constant_s=0.008,
        )  # fmt: skip
        known = {"sensor_time_constant_s": 0.005, "backlash_m": 0.0001}
    assert found.valve == ValveParameters(id="bench", **{**PRESETS[own], "actuator": actuator, **known})
    sensor = plant_settings(own).sensor
    assert found.estimator.noise_of_reading == sensor.noise_of_reading
    assert found.estimator.noise_of_span == sensor.noise_of_span


def test_the_parameters_of_valve_and_sensor_in_the_scenario_have_priority() -> None:
    found = configure(replace(GRAPHITE, valve={"mass_kg": 2.0}, estimator={"noise_of_span": 0.01}))
    assert (found.valve.mass_kg, found.valve.span_m, found.estimator.noise_of_span) == (2.0, 0.025, 0.01)


def test_the_graphite_valve_moves_to_its_setpoints() -> None:
    run = run_in_process(GRAPHITE)
    assert configure(GRAPHITE).valve.span_m == 0.025
    assert abs(run.recording.true_position_m[-1] - 0.015) > 1e-4  # it began at 15 mm


@pytest.mark.parametrize("name", scenario_names())
def test_every_packaged_scenario_is_playable(name: str) -> None:
    scenario = load_scenario(name)
    assert check_playable(scenario, configure(scenario)) == plant_settings(overrides=scenario.plant)


def test_another_valves_preset_is_refused_by_name() -> None:
    assert refused(replace(GRAPHITE, valve={"preset": "paper"})) == [
        "valve.preset = 'paper': the plant is 'graphite'; leave it out, and [valve] follows the plant"
    ]


@pytest.mark.parametrize(("key", "value"), [("span_m", 0.127), ("travel_max_m", 0.0305), ("travel_min_m", 0.001)])
def test_a_span_or_a_travel_that_is_not_the_plants_is_refused_with_both_numbers(key: str, value: float) -> None:
    plant = getattr(plant_settings("graphite").valve, key)
    assert refused(replace(GRAPHITE, valve={key: value})) == [
        f"valve.{key} = {value:g}: contradicts plant.valve.{key} = {plant:g}: give both the same"
    ]


def test_a_plant_of_the_users_own_with_another_span_is_refused_until_the_controller_has_the_same() -> None:
    own = replace(SCENARIO, plant={"valve": {"span_m": 0.1, "travel_max_m": 0.11}})
    assert len(refused(own)) == 2
    check_playable(known := replace(own, valve={"span_m": 0.1, "travel_max_m": 0.11}), configure(known))


def test_setpoints_in_metres_are_refused_with_the_ones_that_were_meant() -> None:
    assert refused(replace(SCENARIO, setpoints_mm=(0.073, 73.0))) == [
        "setpoint 0.073 mm: 4 to 20 mA restart paper both ways from 57.9 to 94.5 mm only; setpoints are in mm: 73?"
    ]


@pytest.mark.parametrize("setpoint_mm", [0.0, 57.8, 94.6, 130.0, 500.0])
def test_setpoints_outside_the_travel_or_beyond_what_the_loop_reaches_are_refused(setpoint_mm: float) -> None:
    (message,) = refused(replace(SCENARIO, setpoints_mm=(setpoint_mm, 80.0)))
    assert message == f"setpoint {setpoint_mm:g} mm: 4 to 20 mA restart paper both ways from 57.9 to 94.5 mm only"


def test_the_currents_are_those_that_the_guard_may_command() -> None:
    low_mm, _ = restartable_mm(plant_settings(), 8.0, 20.0)
    narrow = replace(SCENARIO, guard={"current_low_ma": 8.0}, setpoints_mm=(low_mm - 0.1, low_mm + 0.1))
    (message,) = refused(narrow)
    assert "8 to 20 mA restart paper both ways from " in message


def test_a_plant_that_no_current_frees_both_ways_is_refused() -> None:
    stuck = replace(SCENARIO, plant={"valve": {"static_friction_n": 9000.0}})
    assert refused(stuck) == ["setpoint 73 mm: 4 to 20 mA restart paper both ways from nowhere"]


def test_the_command_refuses_before_it_starts_anything_and_keeps_the_table_of_the_last_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "mine.toml", tmp_path / "out"
    (out / "state").mkdir(parents=True)
    (out / "state" / "kept").touch()
    path.write_text('name = "mine"\ntitle = "t"\nsetpoints_mm = [0.073]\ndwell_s = 0.1\n', encoding="utf-8")
    assert main(["bench", "--scenario", str(path), "--out", str(out)]) == ExitCode.CONFIG
    assert "setpoints are in mm: 73?" in capsys.readouterr().err
    assert [entry.name for entry in (out / "state").iterdir()] == ["kept"]
    assert not (out / "positioner.log").exists()


def test_process_and_supply_bound_the_places_from_which_a_stem_can_be_restarted() -> None:
    free_mm = restartable_mm(plant_settings())
    process = {"force_n": 300.0, "gradient_n_per_m": 5253.8}
    low_mm, high_mm = restartable_mm(plant_settings(overrides={"process": process}))
    push_mm = 300.0 / 52538.0 * 1e3
    assert (low_mm, high_mm) == pytest.approx(tuple((free - push_mm) / 1.1 for free in free_mm), rel=1e-12)
    supplied = plant_settings(overrides={"actuator": {"supply_pa": 17.0 * 5171.06775}})
    assert restartable_mm(supplied) == pytest.approx(restartable_mm(plant_settings(), 4.0, 17.0), rel=1e-12)
