"""Plants by name: presets, plants that others have installed, plant files, and FILE.py:NAME.

A plant from outside is what a plant file holds: its tables, as a mapping, or a function without arguments that returns
them. Shell.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plant_emulator.presets import overridden, plant_settings, preset_names
from positioner.errors import ConfigurationError, Problem
from positioner.inputs.plug_in import Kind, installed, loaded, problem_of
from positioner.inputs.toml_reader import read_text, tables

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings


def plant_names() -> tuple[str, ...]:
    """Return the names of all plants that need no file: the presets, then those that others have installed."""
    return tuple(dict.fromkeys((*preset_names(), *installed(Kind.PLANT))))


def plant_problem(name: str) -> str | None:
    """Return what is wrong with the name of a plant, None where it is one; a file is read later."""
    if name in preset_names() or name.endswith(".toml"):
        return None
    return problem_of(Kind.PLANT, name, preset_names())


def plant_named(name: str) -> PlantSettings:
    """Return the plant of that name.

    Raises:
        ConfigurationError: there is none, its file cannot be read, or a value in it is wrong.
    """
    if name in preset_names():
        return plant_settings(name)
    if name.endswith(".toml"):
        text = read_text(Path(name))
        return overridden(tables(text, name), {}, name, text)
    if problem := plant_problem(name):
        raise ConfigurationError(name, (Problem("plant", None, problem),))
    found = loaded(Kind.PLANT, name)
    if callable(found):
        try:
            found = found()
        except Exception as error:  # code of others may raise anything
            message = f"cannot be made: {type(error).__name__}: {error}"
            raise ConfigurationError(name, (Problem("plant", None, message),)) from error
    if not isinstance(found, Mapping):
        message = f"is a {type(found).__name__}; a plant is the tables of a plant file, or a function that returns them"
        raise ConfigurationError(name, (Problem("plant", None, message),))
    return overridden(found, {}, name)


def complete_tables(settings: PlantSettings) -> dict[str, Any]:
    """Return the tables of a plant file with every value of a plant, also those that its preset has."""
    values: dict[str, Any] = json.loads(json.dumps(asdict(settings), default=str))
    return _without_none(values)


def _without_none(table: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, dict):
            found[key] = _without_none(value)
        elif isinstance(value, list):
            found[key] = [_without_none(each) for each in value]
        elif value is not None:
            found[key] = value
    return found
