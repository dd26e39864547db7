"""Valves by name, for a `[valve]` table with the key `preset`; a table without it gives all parameters itself. Pure.

These are the controller's numbers; the plant emulator's presets of the same names have the same numbers.
"""

from __future__ import annotations

from dataclasses import asdict
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters

if TYPE_CHECKING:
    from collections.abc import Mapping

REQUIRED = (
    "mass_kg",
    "diaphragm_area_m2",
    "pressure_gain_pa_per_ma",
    "spring_rate_n_per_m",
    "static_friction_n",
    "coulomb_friction_n",
    "viscous_friction_n_s_per_m",
    "span_m",
    "travel_max_m",
)
"""The keys that a table without a preset must have; the others have usual values: no preload, and travel from 0."""

_PAPER = {key: value for key, value in asdict(ValveParameters(id="paper")).items() if key != "id"}

PRESETS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "paper": _PAPER,
        "graphite": {
            "mass_kg": 1.361,
            "diaphragm_area_m2": 0.06452,
            "pressure_gain_pa_per_ma": 6819.590825,  # 440 N/mA
            "spring_rate_n_per_m": 206941.0,
            "static_friction_n": 942.0,
            "coulomb_friction_n": 665.0,
            "viscous_friction_n_s_per_m": 70501.0,
            "stribeck_velocity_m_per_s": 0.00326,
            "stick_velocity_m_per_s": 0.0001524,
            "bench_set_n": 0.0,
            "span_m": 0.025,
            "travel_min_m": 0.0,
            "travel_max_m": 0.03,
            "sensor_time_constant_s": 0.0,
            "backlash_m": 0.0,
            "actuator": asdict(ActuatorParameters(fill_time_constant_s=0.1, vent_time_constant_s=0.1)),
        },
        "real-valve": {
            **_PAPER,
            "actuator": asdict(ActuatorParameters(fill_time_constant_s=0.05, vent_time_constant_s=0.05)),
        },
    }
)
"""The paper's valve (Table 3), a slow one with graphite packing, and the paper's with a lag of 50 ms."""


def resolved(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a `[valve]` table without `preset`, whose own values replace those of the preset that it names.

    A table in it, such as `[valve.actuator]`, replaces that of the preset key by key.
    """
    own = {key: value for key, value in table.items() if key != "preset"}
    preset = table.get("preset")
    if not (isinstance(preset, str) and preset in PRESETS):
        return own
    base = PRESETS[preset]
    for key, value in own.items():
        if isinstance(value, dict) and isinstance(base.get(key), dict):
            own[key] = {**base[key], **value}
    return {**base, **own}


def missing(table: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the parameters that a `[valve]` table lacks, if it names no preset."""
    return () if "preset" in table else tuple(key for key in REQUIRED if key not in table)
