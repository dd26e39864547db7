"""From a scenario to the daemon's configuration. Pure."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any

import tomli_w

from plant_emulator.presets import DEFAULT_PRESET, plant_settings, preset_names, root_preset
from positioner.inputs.toml_reader import laid_over
from positioner.valve.parameters import ValveParameters

if TYPE_CHECKING:
    from pathlib import Path

    from plant_emulator.parameters import PlantSettings
    from positioner.bench.scenario import Scenario
    from positioner.bus.address import BusAddress

VALVE_ID = "bench"
"""Identity of the emulated valve: with --state one table serves all scenarios."""


def configuration_text(scenario: Scenario, address: BusAddress, state: Path) -> str:
    """Return the `valve.toml` of the daemon for `scenario`.

    Unless the scenario says otherwise, the daemon has the parameters of the nominal valve and sensor of which the plant
    is a variant, with the preload, the lags and the backlash of the variant.
    """
    preset = scenario.plant.get("preset", DEFAULT_PRESET)
    nominal = root_preset(preset) if preset in preset_names() else DEFAULT_PRESET
    control: dict[str, Any] = {"law": scenario.law, "sample_period_s": scenario.sample_period_s}
    if scenario.table_from_s is not None:
        control["table_from_s"] = scenario.table_from_s
    tables: dict[str, Any] = {
        "valve": {"id": VALVE_ID, "preset": nominal, **laid_over(_known(preset, nominal), scenario.valve)},
        "bus": {key: value for key, value in asdict(address).items() if value != {}},
        "control": {**control, **scenario.control},
        "estimator": {**_nominal_noise(nominal), **scenario.estimator},
        "guard": {"auto_arm": True, **scenario.guard},
        "state": {"directory": str(state)},
    }
    if scenario.wire:
        tables["wire"] = scenario.wire
    return tomli_w.dumps(tables)


def pneumatics_of(settings: PlantSettings) -> dict[str, Any]:
    """Return the part of the `[valve]` table that tells a positioner preload, lags and backlash of a plant."""
    actuator = settings.actuator
    return {
        "bench_set_n": settings.valve.bench_set_n,
        "actuator": {
            "fill_time_constant_s": actuator.fill_time_constant_s,
            "vent_time_constant_s": actuator.vent_time_constant_s,
            "dead_time_s": actuator.dead_time_s,
            "converter_time_constant_s": actuator.converter_time_constant_s,
            "slew_ma_per_s": actuator.slew_pa_per_s / settings.valve.pressure_gain_pa_per_ma,
        },
        "sensor_time_constant_s": settings.sensor.time_constant_s,
        "backlash_m": settings.sensor.backlash_m,
    }


def told(settings: PlantSettings) -> dict[str, Any]:
    """Return the `[valve]` table of a positioner that knows every parameter of the plant it has a word for."""
    valve = settings.valve
    shared = {each.name for each in fields(valve)} & {each.name for each in fields(ValveParameters)}
    table: dict[str, Any] = {name: getattr(valve, name) for name in sorted(shared)}
    table |= pneumatics_of(settings)
    return table


def _known(preset: str, nominal: str) -> dict[str, Any]:
    """Return what the daemon knows of a preset in which it differs from its nominal valve: not spring and friction."""
    if preset not in preset_names():
        return {}
    usual = pneumatics_of(plant_settings(nominal))
    return {key: value for key, value in pneumatics_of(plant_settings(preset)).items() if value != usual[key]}


def _nominal_noise(preset: str) -> dict[str, float]:
    """Return the noise of the sensor of a preset, as its datasheet would give it."""
    sensor = plant_settings(preset).sensor
    return {"noise_of_reading": sensor.noise_of_reading, "noise_of_span": sensor.noise_of_span}
