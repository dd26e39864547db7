"""Reads the file of a campaign, with every mistake in it. Shell."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from plant_emulator.plants import with_physics_in
from plant_emulator.presets import plant_settings
from positioner.bench.inprocess import configure
from positioner.bench.own_plant import with_own_physics
from positioner.bench.scenario import Scenario, check_scenario, load_scenario
from positioner.campaign.check import (
    design_problems,
    end_problems,
    law_problems,
    parameter_problems,
    size_problems,
)
from positioner.campaign.design import Parameter
from positioner.campaign.keys import known_keys, settings_of, value_at
from positioner.campaign.plan import Campaign
from positioner.campaign.schema import CampaignFile
from positioner.errors import ConfigurationError, Problem, UsageError
from positioner.inputs import toml_reader
from positioner.inputs.plug_in import anchored
from positioner.inputs.toml_lines import problem_at

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from positioner.campaign.schema import RangeSettings

_DEFAULT_BASE = "paper-valve"
_GIVEN_ELSEWHERE = {"law": "laws", "seed": "seeds"}


def load_campaign(path: Path) -> Campaign:
    """Return the campaign in the file `path`; a relative path in it starts at the file's folder.

    Raises:
        ConfigurationError: with every mistake in the file.
    """
    text, source = toml_reader.read_text(path), str(path)
    tables = toml_reader.tables(text, source)
    if isinstance(laws := tables.get("laws"), list):
        tables["laws"] = [anchored(law, path.parent) if isinstance(law, str) else law for law in laws]
    problems = [*law_problems(tables, text)]
    file: CampaignFile | None = None
    base: Scenario | None = None
    try:
        file = toml_reader.build(tables, CampaignFile, source, text)
    except ConfigurationError as error:
        problems += error.problems
    try:
        base = _base(tables.get("scenario", {}), text, path)
    except ConfigurationError as error:
        problems += error.problems
    if file is not None:
        problems += [*design_problems(file, text), *parameter_problems(file.parameters, text)]
    if problems or file is None or base is None:
        raise ConfigurationError(source, _by_line(problems))
    base, parameters = _resolved(base, file.parameters)
    base = replace(base, name=file.name, title=file.title, description="")
    campaign = Campaign(file=file, text=text, source=source, base=base, parameters=parameters)
    if problems := [*end_problems(base, parameters, text), *size_problems(campaign)]:
        raise ConfigurationError(source, _by_line(problems))
    return campaign


def _by_line(problems: Iterable[Problem]) -> tuple[Problem, ...]:
    return tuple(sorted(problems, key=lambda problem: problem.line or 0))


def _base(table: Any, text: str, path: Path) -> Scenario:
    """Return the scenario of the `[scenario]` table.

    Raises:
        ConfigurationError: with the mistakes in it.
    """
    if not isinstance(table, dict):
        return load_scenario(_DEFAULT_BASE)  # the type of the key is a mistake that is reported elsewhere
    own = {key: value for key, value in table.items() if key != "base"}
    name = table.get("base", _DEFAULT_BASE)
    problems = [
        problem_at(text, f"scenario.{key}", f"stands in `{_GIVEN_ELSEWHERE[key]}`, above the tables")
        for key in own
        if key in _GIVEN_ELSEWHERE
    ]
    try:
        below = load_scenario(str(path.parent / name) if "/" in name or name.endswith(".toml") else name)
    except (UsageError, ConfigurationError, AttributeError, TypeError) as error:
        where = f"scenario.base = {name!r}"
        raise ConfigurationError(str(path), (*problems, problem_at(text, where, str(error)))) from error
    try:
        scenario = toml_reader.build(toml_reader.laid_over(asdict(below), own), Scenario, str(path))
        scenario = replace(scenario, plant=dict(with_physics_in(scenario.plant, path.parent)))
        check_scenario(scenario, str(path))
    except ConfigurationError as error:
        raise ConfigurationError(str(path), (*problems, *_under("scenario", error, text))) from error
    try:
        scenario = with_own_physics(scenario)
    except ConfigurationError as error:
        raise ConfigurationError(str(path), (*problems, *_under("scenario.plant.physics", error, text))) from error
    for prefix, make in (("scenario.plant", _plant), ("scenario", configure)):
        try:
            make(scenario)
        except ConfigurationError as error:
            problems += _under(prefix, error, text)
    if problems:
        raise ConfigurationError(str(path), tuple(problems))
    return scenario


def _plant(scenario: Scenario) -> object:
    return plant_settings(overrides=scenario.plant)


def _under(prefix: str, error: ConfigurationError, text: str) -> list[Problem]:
    """Return the mistakes in a table as mistakes of the file in which it stands under `prefix`."""
    return [problem_at(text, f"{prefix}.{problem.where}", problem.message) for problem in error.problems]


def _resolved(base: Scenario, ranges: Mapping[str, RangeSettings]) -> tuple[Scenario, tuple[Parameter, ...]]:
    """Return the base with every parameter of each law's table that is changed, and the parameters with their keys.

    The parameters of one law belong together: a configuration that gives one of them must give all.
    """
    settings, known = settings_of(base), known_keys()
    control = dict(base.control)
    parameters = []
    for name, limits in ranges.items():
        keys = limits.scales or (name,)
        for key in keys:
            table, *inner = key.split(".")
            if table == "control" and len(inner) > 1:
                control[inner[0]] = _plain(value_at(settings, f"control.{inner[0]}"))
        kind = float if limits.scales else known[name]
        values = limits.values
        if kind is float and values is not None:
            values = tuple(map(float, values))
        own = {key: float(value_at(settings, key)) if limits.scales else None for key in keys}
        parameters.append(Parameter(name, replace(limits, values=values), tuple(own.items()), whole=kind is int))
    return replace(base, control=control), tuple(parameters)


def _plain(value: Any) -> Any:
    """Return settings as a TOML file holds them: without None."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items() if each is not None}
    return value
