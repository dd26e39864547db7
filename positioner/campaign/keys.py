"""The keys of a scenario that a campaign may change, each with the kind of its value, and how one is set. Pure."""

from __future__ import annotations

from dataclasses import asdict, fields, is_dataclass
from enum import StrEnum
from functools import cache
from typing import TYPE_CHECKING, Any, get_args, get_origin, get_type_hints

from plant_emulator.parameters import PlantSettings
from plant_emulator.presets import plant_settings
from positioner.bench.inprocess import configure
from positioner.bench.scenario import Scenario
from positioner.config.schema import Configuration
from positioner.inputs.toml_reader import laid_over

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from positioner.campaign.schema import Value

_OF_SCENARIO = ("sample_period_s", "setpoint_period_s", "visits", "dwell_s", "table_from_s")
_OF_CONFIGURATION = ("valve", "control", "estimator", "guard")
_SET_OTHERWISE = frozenset(
    ("valve.id", "control.law", "control.parameters", "control.sample_period_s", "control.table_from_s")
)
_KINDS = (bool, int, float, str)
"""A key that may be a float or None counts as a float."""


@cache
def known_keys() -> Mapping[str, type]:
    """Return every key that a campaign may change, with dots, and its kind: bool, int, float or str."""
    hints = get_type_hints(Scenario)
    found = {name: _kind(hints[name]) for name in _OF_SCENARIO}
    found |= dict(_leaves(PlantSettings, "plant"))
    settings = get_type_hints(Configuration)
    for table in _OF_CONFIGURATION:
        found |= dict(_leaves(settings[table], table))
    return {key: kind for key, kind in found.items() if kind is not None and key not in _SET_OTHERWISE}


def _leaves(settings: type[Any], prefix: str) -> Iterator[tuple[str, type | None]]:
    hints = get_type_hints(settings)
    for field in fields(settings):
        key, hint = f"{prefix}.{field.name}", hints[field.name]
        if is_dataclass(hint):
            yield from _leaves(hint, key)  # type: ignore[arg-type]
        else:
            yield key, _kind(hint)


def _kind(hint: Any) -> type | None:
    """Return the kind of a value with this type hint, None where no campaign can change it."""
    if isinstance(hint, type) and issubclass(hint, StrEnum):
        return str
    if get_origin(hint) in (tuple, dict):
        return None
    return next((kind for kind in _KINDS if hint is kind or kind in get_args(hint)), None)


def changed(scenario: Mapping[str, Any], key: str, value: Value) -> dict[str, Any]:
    """Return the tables of a `scenario` with this `value` at the dotted `key`."""
    change: Any = value
    for part in reversed(key.split(".")):
        change = {part: change}
    return laid_over(scenario, change)


def value_at(tables: Mapping[str, Any], key: str) -> Any:
    """Return the value at the dotted `key` of nested tables."""
    found: Any = tables
    for part in key.split("."):
        found = found[part]
    return found


def settings_of(scenario: Scenario) -> dict[str, Any]:
    """Return every setting of `scenario`, also those that it does not give, as nested tables.

    Raises:
        ConfigurationError: its tables do not make a plant or a positioner.
    """
    configuration = asdict(configure(scenario))
    plant = asdict(plant_settings(overrides=scenario.plant))
    return {**asdict(scenario), "plant": plant, **{name: configuration[name] for name in _OF_CONFIGURATION}}
