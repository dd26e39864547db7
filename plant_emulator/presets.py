"""The presets, and plant files that replace values of a preset. Shell: reads files.

A preset is itself a plant file, and may be based on another preset: `spring-10` is `paper` and one line.
"""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING, Any

from plant_emulator.parameters import PlantSettings
from positioner.errors import ConfigurationError
from positioner.inputs.nearest import nearest
from positioner.inputs.toml_lines import problem_at
from positioner.inputs.toml_reader import build, laid_over, read_text, tables

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


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


def load_plant(path: Path) -> PlantSettings:
    """Return the plant in the TOML file `path`.

    Raises:
        ConfigurationError: the file cannot be read, names an unknown preset, or holds an unknown key or a value out
            of its limits.
    """
    return parse_plant(read_text(path), str(path))


def parse_plant(text: str, source: str) -> PlantSettings:
    """Return the plant in the TOML `text`, based on the preset that it names; `source` is for messages.

    Raises:
        ConfigurationError: as `load_plant`.
    """
    return build(_resolved(tables(text, source), source, text), PlantSettings, source, text)


def plant_settings(preset: str = DEFAULT_PRESET, overrides: str | Mapping[str, Any] = "") -> PlantSettings:
    """Return the plant `preset` with the values of `overrides` (TOML text, or nested mappings) instead of its own.

    Raises:
        ConfigurationError: as `load_plant`.
    """
    text = overrides if isinstance(overrides, str) else ""
    values = tables(overrides, "overrides") if isinstance(overrides, str) else dict(overrides)
    return overridden({"preset": preset}, values, "overrides", text)


def overridden(base: Mapping[str, Any], changes: Mapping[str, Any], source: str, text: str = "") -> PlantSettings:
    """Return the plant of the tables `base`, with the values of `changes` instead of its own.

    Raises:
        ConfigurationError: as `load_plant`.
    """
    return build(_resolved(laid_over(base, changes), source, text), PlantSettings, source, text)


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
