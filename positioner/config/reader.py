"""Reads the configuration of one positioner, with every mistake in it. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import tomli_w

from positioner.bus.address import problems_of
from positioner.config.schema import Configuration
from positioner.config.wire_limits import range_problems, wire_problems
from positioner.errors import ConfigurationError, Problem
from positioner.inputs import toml_reader
from positioner.inputs.nearest import nearest
from positioner.inputs.toml_lines import problem_at
from positioner.laws.registry import LAWS
from positioner.valve.presets import PRESETS, missing, resolved

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


def load_config(path: Path, changes: Mapping[str, Any] | None = None) -> Configuration:
    """Return the configuration in `path`, with `changes` laid over it; relative paths lie beside it.

    Raises:
        ConfigurationError: with every mistake in the file: in its values, its DBC and its names.
    """
    text = toml_reader.read_text(path)
    if not changes:
        return parse_config(text, str(path), path.parent)
    changed = tomli_w.dumps(toml_reader.laid_over(toml_reader.tables(text, str(path)), changes))
    try:
        return parse_config(changed, f"{path} with --set", path.parent)
    except ConfigurationError as error:  # lines of a text that nobody has written would mislead
        problems = tuple(Problem(problem.where, None, problem.message) for problem in error.problems)
        raise ConfigurationError(error.source, problems) from error


def parse_config(text: str, source: str, base: Path) -> Configuration:
    """Return the configuration in `text`; relative paths start at `base`.

    Raises:
        ConfigurationError: as `load_config`.
    """
    tables = toml_reader.tables(text, source)
    problems: list[Problem] = []
    found: Configuration | None = None
    _anchor(tables, base)
    _name_channel(tables)
    problems += _valve_problems(tables, text)
    if isinstance(tables.get("valve"), dict):
        tables["valve"] = resolved(tables["valve"])
    try:
        found = toml_reader.build(tables, Configuration, source, text)
    except ConfigurationError as error:
        problems += error.problems
    problems += wire_problems(tables, text)
    problems += _law_problems(tables, text)
    if found is not None:
        problems += [problem_at(text, f"bus.{where}", what) for where, what in problems_of(found.bus)]
    if found is not None and not problems:
        problems += range_problems(found, text)
    if problems or found is None:
        raise ConfigurationError(source, tuple(sorted(problems, key=lambda problem: problem.line or 0)))
    return found


def _anchor(tables: dict[str, Any], base: Path) -> None:
    """Let a relative path in the tables start at the folder of the file, not at the current one."""
    for table, key in (("wire", "dbc"), ("state", "directory")):
        found = tables.get(table)
        if isinstance(found, dict) and isinstance(found.get(key), str):
            found[key] = str(base / found[key])


def _name_channel(tables: dict[str, Any]) -> None:
    """Turn a channel that is written as a number into a name."""
    bus = tables.get("bus")
    if isinstance(bus, dict) and type(bus.get("channel")) is int:
        bus["channel"] = str(bus["channel"])


def _law_problems(tables: dict[str, Any], text: str) -> list[Problem]:
    control = tables.get("control")
    law = control.get("law") if isinstance(control, dict) else None
    if not isinstance(law, str) or law in LAWS:
        return []
    return [problem_at(text, f"control.law = '{law}'", f"is no law; {nearest(law, LAWS)}")]


def _valve_problems(tables: dict[str, Any], text: str) -> list[Problem]:
    """Return the mistakes in `[valve]`, which names a preset, or gives all parameters: an id alone is no valve."""
    valve = tables.get("valve")
    if not isinstance(valve, dict):
        return []
    preset = valve.get("preset")
    if preset is not None and not (isinstance(preset, str) and preset in PRESETS):
        return [problem_at(text, f"valve.preset = {preset!r}", f"is no valve; {nearest(str(preset), PRESETS)}")]
    if lacks := missing(valve):
        message = f"lacks {', '.join(lacks)}: give them, or name a valve with `preset` ({', '.join(PRESETS)})"
        return [problem_at(text, "valve", message)]
    return []
