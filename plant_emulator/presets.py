"""The presets, and plant files that replace values of a preset. Shell: reads files.

A preset is itself a plant file, and may be based on another preset: `spring-10` is `paper` and one line.
"""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING, Any

from plant_emulator.parameters import PlantSettings
from plant_emulator.schedule import changes as scheduled
from positioner.errors import ConfigurationError
from positioner.inputs.nearest import nearest
from positioner.inputs.toml_lines import problem_at
from positioner.inputs.toml_reader import build, laid_over, tables

if TYPE_CHECKING:
    from collections.abc import Mapping


DEFAULT_PRESET = "paper"


def preset_names() -> tuple[str, ...]:
    """Return the names of the presets, sorted."""
    files = resources.files("plant_emulator").joinpath("presets").iterdir()
    return tuple(sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml")))


def root_preset(name: str) -> str:
    """Return the preset on which `name` is based in the end, or `name` itself."""
    below = tables(_preset_text(name), name).get("preset")
    return name if below is None else root_preset(below)


def preset_summary(name: str) -> str:
    """Return the first comment line of the preset `name`, its description."""
    return _preset_text(name).partition("\n")[0].removeprefix("#").strip()


def plant_settings(preset: str = DEFAULT_PRESET, overrides: str | Mapping[str, Any] = "") -> PlantSettings:
    """Return the plant `preset` with the values of `overrides` (TOML text, or nested mappings) instead of its own.

    Raises:
        ConfigurationError: as `overridden`.
    """
    text = overrides if isinstance(overrides, str) else ""
    values = tables(overrides, "overrides") if isinstance(overrides, str) else dict(overrides)
    return overridden({"preset": preset}, values, "overrides", text)


def overridden(base: Mapping[str, Any], changes: Mapping[str, Any], source: str, text: str = "") -> PlantSettings:
    """Return the plant of the tables `base`, with the values of `changes` instead of its own.

    source, text: name and content of the file behind the tables, for messages.

    Raises:
        ConfigurationError: an unknown preset, an unknown key, or a value outside its limits.
    """
    values = _resolved(laid_over(base, changes), source, text)
    settings = build(values, PlantSettings, source, text)
    for change in scheduled(settings):
        table, name = change.key.split(".")
        values = laid_over(values, {table: {name: change.value}})
        build(values, PlantSettings, f"{source}: schedule at {change.at_s:g} s", text)
    return settings


def _resolved(values: Mapping[str, Any], source: str, text: str) -> dict[str, Any]:
    if "preset" not in values:
        return dict(values)
    name = values["preset"]
    if name not in preset_names():
        message = f"is no preset; {nearest(str(name), preset_names())}"
        raise ConfigurationError(source, (problem_at(text, f"preset = {name!r}", message),))
    below = _preset_text(name)
    return laid_over(_resolved(tables(below, name), name, below), values)


def _preset_text(name: str) -> str:
    return resources.files("plant_emulator").joinpath("presets", f"{name}.toml").read_text(encoding="utf-8")
