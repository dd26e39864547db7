"""From a scenario to the daemon's configuration. Pure."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import tomli_w

from plant_emulator.presets import DEFAULT_PRESET, plant_settings, preset_names, root_preset

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.bench.scenario import Scenario
    from positioner.bus.address import BusAddress

VALVE_ID = "bench"
"""Identity of the emulated valve: with --state one table serves all scenarios."""


def configuration_text(scenario: Scenario, address: BusAddress, state: Path) -> str:
    """Return the `valve.toml` of the daemon for `scenario`.

    Unless the scenario says otherwise, the daemon has the parameters of the nominal valve and sensor of which the plant
    is a variant.
    """
    preset = scenario.plant.get("preset", DEFAULT_PRESET)
    nominal = root_preset(preset) if preset in preset_names() else DEFAULT_PRESET
    control: dict[str, Any] = {"law": scenario.law, "sample_period_s": scenario.sample_period_s}
    if scenario.table_from_s is not None:
        control["table_from_s"] = scenario.table_from_s
    tables: dict[str, Any] = {
        "valve": {"id": VALVE_ID, "preset": nominal, **_preload(preset, nominal), **scenario.valve},
        "bus": {key: value for key, value in asdict(address).items() if value != {}},
        "control": {**control, **scenario.control},
        "estimator": {**_nominal_noise(nominal), **scenario.estimator},
        "guard": {"auto_arm": True, **scenario.guard},
        "state": {"directory": str(state)},
    }
    return tomli_w.dumps(tables)


def _preload(preset: str, nominal: str) -> dict[str, float]:
    """Return the bench set of a preset that has another one than its nominal valve: it is known, as the travel is."""
    if preset not in preset_names():
        return {}
    bench_set_n = plant_settings(preset).valve.bench_set_n
    return {} if bench_set_n == plant_settings(nominal).valve.bench_set_n else {"bench_set_n": bench_set_n}


def _nominal_noise(preset: str) -> dict[str, float]:
    """Return the noise of the sensor of a preset, as its datasheet would give it."""
    sensor = plant_settings(preset).sensor
    return {"noise_of_reading": sensor.noise_of_reading, "noise_of_span": sensor.noise_of_span}
