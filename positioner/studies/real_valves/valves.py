"""The valves of this league: an emulated plant with a lag and a sensor, and what its law is told about it. Pure.

Every law, rivals too, gets the parameters of the plant that it controls, as an identification gives them. A condition
(`conditions`) may tell it others.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from plant_emulator.presets import plant_settings
from positioner.bench.playable import within_reach
from positioner.inputs.toml_reader import laid_over

if TYPE_CHECKING:
    from collections.abc import Mapping

    from plant_emulator.parameters import PlantSettings

NOMINAL = "paper"
STOCHASTIC = "stochastic"
PLANTS = (NOMINAL, "spring-20", "spring+20", "friction-20", "friction+20", STOCHASTIC)
"""Presets of the emulator that are played at every lag."""
GRAPHITE = "graphite"
"""A valve with a lag of its own, played at that one only."""
ALL_PLANTS = (*PLANTS, GRAPHITE)

LAGS_S = (0.0, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.3)
"""Time constants of filling and of venting."""

NOISES: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "0.05": {"noise_of_span": 0.0005, "noise_of_reading": 0.0},
        "2": {"noise_of_span": 0.0, "noise_of_reading": 0.02},
    }
)
"""The sensors, by the percentage in their name: of the span, and of the reading."""
NOISE_NAMES: Mapping[str, str] = MappingProxyType({"0.05": "0.05 % of span", "2": "2 % of reading"})

_START = 0.085
_PLACES = (0.413, 0.795, 0.604, 0.426, 0.645, 0.686, 0.467, 0.754)
"""The setpoints of the league, as parts of the range from which the nominal valve can be restarted."""


def plant_tables(plant: str, lag_s: float, noise: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the `[plant]` table of a scenario: the preset `plant` with this lag and sensor, and then `changes`.

    The stem starts at the same part of its range on every plant.
    """
    settings = plant_settings(plant)
    (start_mm,) = within_reach(settings, (_START,))
    base = {
        "preset": plant,
        "valve": {"initial_position_m": start_mm * 1e-3},
        "actuator": lag_table(lag_s),
        "sensor": dict(NOISES[noise]),
    }
    return laid_over(base, changes)


def lag_table(lag_s: float) -> dict[str, float]:
    """Return the `[actuator]` table of a diaphragm that fills and vents with the time constant `lag_s`."""
    return {"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s}


def setpoints_mm(plant: PlantSettings) -> tuple[float, ...]:
    """Return eight setpoints in mm: those of the league, at the same parts of the range of `plant`."""
    return within_reach(plant, _PLACES)
