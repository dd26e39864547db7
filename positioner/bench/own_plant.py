"""A scenario with a plant by name; what the positioner is told about a plant that is no preset. Shell: reads files."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from plant_emulator.plants import complete_tables, plant_named
from plant_emulator.presets import preset_names
from positioner.bench.configure import told
from positioner.inputs.toml_reader import laid_over

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings
    from positioner.bench.scenario import Scenario


def with_plant(scenario: Scenario, name: str) -> Scenario:
    """Return the scenario on the plant `name`; what the scenario changes in its plant, it changes in this one, too.

    Raises:
        ConfigurationError: there is no such plant, or a value of it is wrong.
    """
    if name in preset_names():
        changes = {key: value for key, value in scenario.plant.items() if key != "physics"}
        return replace(scenario, plant={**changes, "preset": name})
    return on_own_plant(scenario, plant_named(name))


def with_own_physics(scenario: Scenario) -> Scenario:
    """Return the scenario with the tables of the physics that its plant names, where it names some, under its own.

    Raises:
        ConfigurationError: the code of the physics cannot be loaded, or its tables are wrong.
    """
    physics = scenario.plant.get("physics")
    return with_plant(scenario, physics) if isinstance(physics, str) else scenario


def on_own_plant(scenario: Scenario, settings: PlantSettings) -> Scenario:
    """Return the scenario on a plant that is no preset: the positioner is told its valve and the noise of its sensor.

    Its spring is that of the valve and the process together, as an identification finds it. The scenario's own
    `[valve]` and `[estimator]` still come first: with them it can be told something wrong.
    """
    process, own = settings.process, told(settings)
    # a valve shows only the sum of spring and process
    own["spring_rate_n_per_m"] += process.gradient_n_per_m
    own["bench_set_n"] = max(own["bench_set_n"] + process.force_n, 0.0)
    changes = {key: value for key, value in scenario.plant.items() if key not in {"preset", "physics"}}
    sensor = settings.sensor
    noise = {"noise_of_reading": sensor.noise_of_reading, "noise_of_span": sensor.noise_of_span}
    return replace(
        scenario,
        plant=laid_over(complete_tables(settings), changes),
        valve=laid_over(own, scenario.valve),
        estimator={**noise, **scenario.estimator},
    )
