"""`[valve]` gives its parameters or names a valve: an id alone is no valve, and never silently the paper's."""

from __future__ import annotations

import tomllib
from dataclasses import asdict, fields
from importlib import resources
from pathlib import Path

import pytest

from plant_emulator.presets import plant_settings, preset_names, root_preset
from positioner.cli.main import main
from positioner.config.reader import parse_config
from positioner.errors import ConfigurationError, ExitCode
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters
from positioner.valve.presets import PRESETS, REQUIRED


def problems_of(text: str) -> list[str]:
    with pytest.raises(ConfigurationError) as caught:
        parse_config(text, "valve.toml", Path())
    return [str(problem) for problem in caught.value.problems]


def test_every_valve_that_a_plant_is_a_variant_of_has_a_preset_of_the_same_name_and_numbers() -> None:
    assert {root_preset(name) for name in preset_names()} == set(PRESETS)
    for name, numbers in PRESETS.items():
        plant = plant_settings(name)
        lags = {key: value for key, value in asdict(plant.actuator).items() if key in numbers["actuator"]}
        theirs = {**asdict(plant.valve), "sensor_time_constant_s": 0.0, "backlash_m": 0.0}
        theirs["actuator"] = {**asdict(ActuatorParameters()), **lags}
        assert dict(numbers) == {key: theirs[key] for key in numbers}
        assert set(numbers) == {field.name for field in fields(ValveParameters)} - {"id"}


def test_check_refuses_an_id_alone_and_says_what_it_lacks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "valve.toml"
    path.write_text('[valve]\nid = "FV-101"\n', encoding="utf-8")
    assert main(["check", str(path)]) == ExitCode.CONFIG
    (line,) = capsys.readouterr().err.splitlines()
    assert line == (
        f"positioner: {path}: line 1: valve: lacks {', '.join(REQUIRED)}: give them, or name a valve with "
        "`preset` (paper, graphite, real-valve)"
    )


def test_a_single_parameter_that_is_missing_is_named() -> None:
    own = tomllib.loads((resources.files("positioner") / "example.toml").read_text(encoding="utf-8"))["valve"]
    for lacking in REQUIRED:
        table = "".join(f"{key} = {value!r}\n" for key, value in own.items() if key not in {lacking, "actuator"})
        (problem,) = problems_of("[valve]\n" + table)
        assert problem.startswith(f"line 1: valve: lacks {lacking}: ")


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_gives_all_and_what_stands_beside_it_counts_more(name: str) -> None:
    found = parse_config(f'[valve]\nid = "v"\npreset = "{name}"\nmass_kg = 7.5\n', "valve.toml", Path())
    numbers = {**PRESETS[name], "mass_kg": 7.5, "actuator": ActuatorParameters(**PRESETS[name]["actuator"])}
    assert found.valve == ValveParameters(id="v", **numbers)


def test_a_lag_beside_a_preset_leaves_its_other_lags() -> None:
    text = '[valve]\nid = "v"\npreset = "graphite"\n[valve.actuator]\ndead_time_s = 0.003\n'
    found = parse_config(text, "valve.toml", Path())
    lags = ActuatorParameters(fill_time_constant_s=0.1, vent_time_constant_s=0.1, dead_time_s=0.003)
    assert found.valve.actuator == lags


@pytest.mark.parametrize(
    ("given", "hint"), [('"graphit"', "did you mean 'graphite'?"), ("3", "known: paper, graphite, real-valve")]
)
def test_an_unknown_preset_is_refused_with_the_nearest_name(given: str, hint: str) -> None:
    (problem,) = problems_of(f'[valve]\nid = "v"\npreset = {given}\n')
    assert problem.startswith("line 3: valve.preset = ")
    assert hint in problem


def test_all_parameters_together_need_no_preset() -> None:
    numbers = "".join(f"{key} = {value}\n" for key, value in PRESETS["graphite"].items() if key in REQUIRED)
    found = parse_config('[valve]\nid = "v"\n' + numbers, "valve.toml", Path())
    assert found.valve.span_m == 0.025
    assert found.valve.bench_set_n == 0.0
