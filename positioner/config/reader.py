"""Reads a configuration, of one valve or of several, with every mistake in it. Shell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from positioner.bus.address import BusAddress, problems_of
from positioner.config.locations import location_of
from positioner.config.schema import Configuration, OneOfSeveral
from positioner.config.several import clashes, in_order, placed, sections_of
from positioner.config.wire_limits import range_problems, wire_problems
from positioner.errors import ConfigurationError, Problem, UsageError
from positioner.guard.settings import GuardSettings
from positioner.inputs import toml_reader
from positioner.inputs.nearest import check_name, nearest
from positioner.inputs.plug_in import anchored
from positioner.inputs.toml_lines import line_of, problem_at
from positioner.laws.registry import is_outside, law_problem
from positioner.laws.settings import ControlSettings
from positioner.metrics.places import file_problem, socket_problem
from positioner.metrics.settings import MetricsSettings
from positioner.valve.parameters import ValveParameters, id_problem
from positioner.valve.presets import PRESETS, missing, resolved
from positioner.wire.codec import make_codec
from positioner.wire.settings import WireSettings

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from positioner.inputs.table import SettingsTable


def load_config(path: Path, changes: Mapping[str, Any] | None = None, valve: str | None = None) -> Configuration:
    """Return the configuration of one valve in `path`, with `changes` laid over it; relative paths lie beside the file.

    `valve` is the id of the one that is meant, needed only where the file has several.

    Raises:
        ConfigurationError: with every mistake in the file: in its values, its DBC and its names.
        UsageError: the file has no such valve, or several and none was named.
    """
    text = toml_reader.read_text(path)
    tables = toml_reader.tables(text, str(path))
    if not changes:
        found = _valves(tables, text, str(path), path.parent)
        return found[_number([configuration.valve.id for configuration in found], valve, path)]
    several = _has_several(tables)
    if several:
        sections = sections_of(tables)
        tables = sections[_number([section.name for section in sections], valve, path)].tables
    # no text: lines of a text that nobody has written would mislead
    kind = OneOfSeveral if several else Configuration
    changed = _checked(toml_reader.laid_over(tables, changes), "", f"{path} with --set", path.parent, kind)
    _number([changed.valve.id], valve, path)
    return changed


def load_valves(path: Path, *, places: bool = False) -> tuple[Configuration, ...]:
    """Return the configurations of all valves in `path`, in their order; relative paths lie beside the file.

    places: look at what stands on this machine now where the metrics are to go, too.

    Raises:
        ConfigurationError: as `load_config`, and where two valves get into each other's way.
    """
    text = toml_reader.read_text(path)
    return _valves(toml_reader.tables(text, str(path)), text, str(path), path.parent, places=places)


def parse_config(text: str, source: str, base: Path) -> Configuration:
    """Return the configuration in `text`, which has one valve; relative paths start at `base`.

    Raises:
        ConfigurationError: as `load_config`.
    """
    return _checked(toml_reader.tables(text, source), text, source, base)


def _valves(
    tables: dict[str, Any], text: str, source: str, base: Path, *, places: bool = False
) -> tuple[Configuration, ...]:
    if not _has_several(tables):
        return (_checked(tables, text, source, base, places=places),)
    sections = sections_of(tables)
    found: list[Configuration | None] = []
    mistakes: list[tuple[Problem, ...]] = []
    for section in sections:
        try:
            found.append(_checked(section.tables, "", source, base, OneOfSeveral, places=places))
            mistakes.append(())
        except ConfigurationError as error:
            found.append(None)
            mistakes.append(error.problems)
    problems = in_order((*placed(sections, mistakes, text), *clashes(found, text)))
    if not sections:
        problems = (Problem("valve", line_of(text, ("valve",)), "has no valve: begin each one with [[valve]]"),)
    if problems:
        raise ConfigurationError(source, problems)
    return tuple([each for each in found if each is not None])


def _has_several(tables: Mapping[str, Any]) -> bool:
    return isinstance(tables.get("valve"), list)


def _number(names: Sequence[str], valve: str | None, path: Path) -> int:
    """Return which of the valves is meant.

    Raises:
        UsageError: there is no such valve, or there are several and none was named.
    """
    if valve is None and len(names) > 1:
        raise UsageError(f"{path} has the valves {', '.join(names)}: name one of them with --valve")
    if valve is not None:
        check_name("valve", valve, tuple(names))
    return 0 if valve is None else names.index(valve)


def _checked(
    tables: dict[str, Any],
    text: str,
    source: str,
    base: Path,
    kind: type[Configuration] = Configuration,
    *,
    places: bool = False,
) -> Configuration:
    """Return the configuration of one valve in `tables`. Every rule is asked whose own tables can be read.

    Raises:
        ConfigurationError: as `load_config`, with the lines in `text`.
    """
    found: Configuration | None = None
    _anchor(tables, base)
    _name_channel(tables)
    problems = _valve_problems(tables, text)
    is_whole = not problems
    if isinstance(tables.get("valve"), dict):
        tables = {**tables, "valve": resolved(tables["valve"])}
        problems += _id_problems(tables["valve"], text)
    try:
        found = toml_reader.build(tables, kind, source, text)
    except ConfigurationError as error:
        problems += error.problems
    of_the_wire = wire_problems(tables, text)
    problems += of_the_wire
    problems += _law_problems(tables, text)
    bus, valve, guard = (_part(tables, name, own) for name, own in _PARTS.items())
    if isinstance(bus, BusAddress):
        problems += [problem_at(text, f"bus.{where}", what) for where, what in problems_of(bus)]
    if isinstance(valve, ValveParameters) and isinstance(guard, GuardSettings) and is_whole and not of_the_wire:
        wire = _part(tables, "wire", WireSettings)
        if isinstance(wire, WireSettings):
            problems += range_problems(make_codec(wire, span_m=valve.span_m), valve, guard, text)
    if places:
        problems += _place_problems(tables, text, found, Path(source))
    if problems or found is None:
        raise ConfigurationError(source, tuple(sorted(problems, key=lambda problem: problem.line or 0)))
    return found


_PARTS: Mapping[str, type[SettingsTable]] = {"bus": BusAddress, "valve": ValveParameters, "guard": GuardSettings}
"""Tables with rules beyond their own limits, which are asked even where another table has a mistake."""


def _part(tables: dict[str, Any], name: str, kind: type[SettingsTable]) -> SettingsTable | None:
    """Return one table alone; None where it has a mistake of its own."""
    try:
        return toml_reader.build(tables.get(name, {}), kind, name)
    except ConfigurationError:
        return None


def _place_problems(tables: dict[str, Any], text: str, found: Configuration | None, path: Path) -> list[Problem]:
    """Return what stands where the metrics are to go and is not ours; the socket of a running daemon is its own."""
    metrics = _part(tables, "metrics", MetricsSettings)
    from positioner.store.lock import holder  # noqa: PLC0415 - for a `check` alone: no bench or bout loads the store

    if not isinstance(metrics, MetricsSettings):
        return []
    asked = [("file", metrics.file, file_problem)]
    if found is not None and holder(location_of(found, path).state) is None:
        asked.append(("socket", metrics.socket, socket_problem))
    told = [(key, place, problem_of(place)) for key, place, problem_of in asked if place is not None]
    return [problem_at(text, f"metrics.{key} = '{place}'", problem) for key, place, problem in told if problem]


def _anchor(tables: dict[str, Any], base: Path) -> None:
    """Let a relative path in the tables start at the folder of the file, not at the current one."""
    for table, key in (("wire", "dbc"), ("state", "directory"), ("metrics", "file"), ("metrics", "socket")):
        found = tables.get(table)
        if isinstance(found, dict) and isinstance(found.get(key), str):
            found[key] = str(base / found[key])
    control = tables.get("control")
    if not isinstance(control, dict):
        return
    if control.get("shadow") == "":
        del control["shadow"]
    for key in _LAW_KEYS:
        if isinstance(control.get(key), str):
            control[key] = anchored(control[key], base)


_LAW_KEYS = ("law", "shadow")


def _name_channel(tables: dict[str, Any]) -> None:
    """Turn a channel that is written as a number into a name."""
    bus = tables.get("bus")
    if isinstance(bus, dict) and type(bus.get("channel")) is int:
        bus["channel"] = str(bus["channel"])


def _law_problems(tables: dict[str, Any], text: str) -> list[Problem]:
    control = tables.get("control")
    if not isinstance(control, dict):
        return []
    named = {key: law for key in _LAW_KEYS if isinstance(law := control.get(key), str)}
    wrong = {key: law_problem(law, unknown="is no law") for key, law in named.items()}
    if any(wrong.values()):
        return [problem_at(text, f"control.{key} = '{named[key]}'", told) for key, told in wrong.items() if told]
    if named.get("shadow") == named.get("law", ControlSettings().law):
        told = "is the law that controls the valve; a shadow is another one, or leave it out"
        return [problem_at(text, f"control.shadow = '{named['shadow']}'", told)]
    if control.get("parameters") and named and not any(is_outside(law) for law in named.values()):
        law = next(iter(named.values()))
        return [problem_at(text, "control.parameters", f"are for a law from outside; {law} has settings of its own")]
    return []


def _id_problems(valve: dict[str, Any], text: str) -> list[Problem]:
    """Return the mistake in the id of a valve, which gets another one: the rules of all other keys are asked, too."""
    given = valve.get("id")
    message = "is required and missing" if given is None else id_problem(given)
    if not message:
        return []
    valve["id"] = "valve"
    return [problem_at(text, "valve.id" if given is None else f"valve.id = {toml_reader.written(given)}", message)]


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
