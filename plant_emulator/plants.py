"""Plants by name: presets, plants that others have installed, plant files, and FILE.py:NAME.

A plant from outside is what a plant file holds: its tables, as a mapping, or a function without arguments that returns
them. Or it has its own physics (`plant_emulator.own_physics`). Shell.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plant_emulator.own_physics import is_physics, made, tables_of
from plant_emulator.presets import DEFAULT_PRESET, overridden, plant_settings, preset_names
from positioner.errors import ConfigurationError, PositionerError, Problem
from positioner.inputs.plug_in import Kind, anchored, file_and_name, installed, is_interrupt, problem_of, text_of_error
from positioner.inputs.toml_reader import laid_over, read_text, tables

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings

_UNDER_OWN_PHYSICS = {"preset": DEFAULT_PRESET, "sensor": {"noise_of_reading": 0.0, "noise_of_span": 0.0}}
"""What a plant with its own physics has where its tables say nothing."""


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
        return plant_in_file(Path(name))
    if problem := plant_problem(name):
        raise ConfigurationError(name, (Problem("plant", None, problem),))
    found = made(name)
    if is_physics(found):
        return _of_others(name, tables_of(name, found), _UNDER_OWN_PHYSICS, {"physics": anchored(name, Path.cwd())})
    if not isinstance(found, Mapping):
        what = "the tables of a plant file, a function that returns them, or physics (docs/own-plant.md)"
        raise ConfigurationError(name, (Problem("plant", None, f"is a {type(found).__name__}; a plant is {what}"),))
    own_file = file_and_name(name)
    folder = Path.cwd() if own_file is None else own_file.file.absolute().parent
    return _of_others(name, with_physics_in(found, folder), {}, {})


def _of_others(
    name: str, tables: Mapping[str, Any], below: Mapping[str, Any], above: Mapping[str, Any]
) -> PlantSettings:
    """Return the plant of tables that the code of others has made."""
    try:
        return overridden(laid_over(below, tables), above, name)
    except PositionerError:
        raise
    except BaseException as error:  # such as a table that holds itself
        if is_interrupt(error):
            raise
        message = f"cannot be read: {text_of_error(error)}; give plain tables, as a plant file has them"
        raise ConfigurationError(name, (Problem("tables", None, message),)) from error


def plant_in_file(path: Path, changes: Mapping[str, Any] | None = None) -> PlantSettings:
    """Return the plant of a plant file, with the values of `changes` instead of its own.

    Raises:
        ConfigurationError: as `plant_named`.
    """
    text = read_text(path)
    source = f"{path} with --set" if changes else str(path)
    return overridden(with_physics_in(tables(text, str(path)), path.absolute().parent), changes or {}, source, text)


def with_physics_in(plant: Mapping[str, Any], folder: Path) -> Mapping[str, Any]:
    """Return the tables of a plant with the file of its own physics beside `folder`, where that file is relative."""
    physics = plant.get("physics")
    return {**plant, "physics": anchored(physics, folder.absolute())} if isinstance(physics, str) else plant


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
            found[key] = [_without_none(each) if isinstance(each, dict) else each for each in value]
        elif value is not None:
            found[key] = value
    return found
