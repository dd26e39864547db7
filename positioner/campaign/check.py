"""Mistakes of a campaign that no limit of a single value shows. Pure."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING, Any

from plant_emulator.presets import plant_settings
from positioner.bench.inprocess import configure
from positioner.bench.playable import check_playable
from positioner.bench.scenario import check_scenario
from positioner.campaign.design import size
from positioner.campaign.keys import known_keys
from positioner.campaign.plan import scenario_at
from positioner.campaign.run import COLUMNS
from positioner.campaign.schema import Kind
from positioner.errors import ConfigurationError, Problem
from positioner.inputs.toml_lines import line_of, problem_at
from positioner.laws.registry import law_problem

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from positioner.bench.scenario import Scenario
    from positioner.campaign.design import Parameter
    from positioner.campaign.plan import Campaign
    from positioner.campaign.schema import CampaignFile, RangeSettings, Value

MOST_RUNS = 100_000
_MOST_POINTS_NAMED = 10
_WHOLE_FROM, _WHOLE_BELOW = 1e4, 1e7
"""Values of this size are shown without an exponent."""
_KEYS = "`positioner campaign --keys` lists them all"


def law_problems(tables: Mapping[str, Any], text: str) -> Iterator[Problem]:
    """Yield the laws that there are not."""
    laws = tables.get("laws")
    for law in laws if isinstance(laws, list) else ():
        if isinstance(law, str) and (problem := law_problem(law, unknown="is no law")):
            yield problem_at(text, f"laws = {law!r}", problem)


def design_problems(file: CampaignFile, text: str) -> Iterator[Problem]:
    """Yield what does not fit together in the design and the ranges."""
    kind, points = file.design.kind, file.design.points
    ranges = {name: limits for name, limits in file.parameters.items() if limits.values is None}
    if kind is Kind.GRID:
        if points is not None:
            yield problem_at(
                text, f"design.points = {points}", "a grid has the points that its levels make: leave it out"
            )
        for name, limits in ranges.items():
            if limits.levels is None:
                yield _of(name, text, "needs levels: how many values of the range the grid takes")
        return
    for name, limits in ranges.items():
        if limits.levels is not None:
            yield _of(name, text, "levels are for a grid only; design.points is their number")
    if points is None:
        yield problem_at(text, "design", "needs points: how many there are")
    elif kind is Kind.SOBOL and points.bit_count() != 1:
        below = 1 << (points.bit_length() - 1)
        text_ = f"a Sobol sequence is even at powers of two only: {below} or {2 * below}?"
        yield problem_at(text, f"design.points = {points}", text_)


def parameter_problems(ranges: Mapping[str, RangeSettings], text: str) -> Iterator[Problem]:
    """Yield the keys that there are not, those that are changed twice, and values of the wrong kind."""
    known = known_keys()
    changed_by: dict[str, str] = {}
    for name, limits in ranges.items():
        if limits.scales and name in COLUMNS:
            yield _of(name, text, "is the name of a column of the results: give it another one")
        for key in limits.scales or (name,):
            if key not in known:
                close = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
                yield _of(name, text, f"{key!r} is no key{f'; did you mean {close[0]!r}?' if close else ''}; {_KEYS}")
                continue
            if key in changed_by:
                yield _of(name, text, f"{key} is changed by {changed_by[key]!r}, too")
            changed_by[key] = name
            if problem := _kind_problem(limits, key, known[key]):
                yield _of(name, text, problem)


def _kind_problem(limits: RangeSettings, key: str, kind: type) -> str:
    if limits.scales and kind is not float:
        return f"{key} is no number that can be multiplied"
    if limits.scales and not _are_numbers(limits.values or ()):
        return "only numbers multiply a value"
    if limits.scales:
        return ""
    if limits.values is None:
        if kind not in {int, float}:
            return f"{key} is no number: give values"
        is_whole = kind is float or all(end is None or end.is_integer() for end in (limits.low, limits.high))
        return "" if is_whole else f"{key} is a whole number, so low and high must be, too"
    fits = _are_numbers(limits.values) if kind is float else all(type(value) is kind for value in limits.values)
    names = {int: "whole numbers", float: "numbers", bool: "true and false", str: "texts"}
    return "" if fits else f"the values of {key} must be {names[kind]}"


def _are_numbers(values: Iterable[Value]) -> bool:
    return all(type(value) in {int, float} for value in values)


def size_problems(campaign: Campaign) -> Iterator[Problem]:
    """Yield a problem where there are too many runs."""
    runs = size(campaign.file.design, campaign.parameters) * len(campaign.laws) * len(campaign.seeds)
    if runs > MOST_RUNS:
        message = f"makes {runs} runs with the laws and the seeds; a campaign has at most {MOST_RUNS}"
        yield problem_at(campaign.text, "design", message)


def end_problems(base: Scenario, parameters: Iterable[Parameter], text: str) -> Iterator[Problem]:
    """Yield each end of a range, or value of a list, that is out of the limits of its key."""
    for parameter in parameters:
        for value in parameter.range.values or parameter.ends:
            scenario = scenario_at(base, (parameter,), (round(value) if parameter.whole else value,))  # type: ignore[arg-type]
            for key, message in _single_problems(scenario):
                if key in dict(parameter.keys):
                    yield _of(parameter.name, text, f"{value!r}: {message}")


def _single_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield the key of each value that is out of its limits, and the message."""
    checks = (
        ("", lambda: check_scenario(scenario, "")),
        ("plant.", lambda: plant_settings(overrides=scenario.plant)),
        ("", lambda: configure(scenario)),
    )
    for prefix, check in checks:
        try:
            check()
        except ConfigurationError as error:
            for problem in error.problems:
                yield prefix + problem.where.partition(" = ")[0], problem.message


def check_points(campaign: Campaign, points: Iterable[tuple[Value, ...]]) -> None:
    """Check that the plant of every point can be played; a point has the number of its place.

    Raises:
        ConfigurationError: with the first points that cannot be played, and the number of all of them.
    """
    problems = []
    for number, values in enumerate(points):
        scenario = scenario_at(campaign.base, campaign.parameters, values)
        try:
            check_scenario(scenario, campaign.source)
            check_playable(scenario, configure(scenario))
        except ConfigurationError as error:
            named = zip(campaign.parameters, values, strict=True)
            where = ", ".join(f"{each.name} = {shown(value)}" for each, value in named)
            first = error.problems[0]
            problems.append(Problem(f"point {number} ({where})", None, f"{first.where}: {first.message}"))
    if len(problems) > _MOST_POINTS_NAMED:
        more = Problem(
            "design", None, f"{len(problems)} points in all cannot be played: narrow the ranges or the setpoints"
        )
        problems = [*problems[:_MOST_POINTS_NAMED], more]
    if problems:
        raise ConfigurationError(campaign.source, tuple(problems))


def shown(value: Value) -> str:
    """Return a value of a parameter in few characters."""
    if not isinstance(value, float):
        return str(value)
    return f"{value:.0f}" if _WHOLE_FROM <= abs(value) < _WHOLE_BELOW else f"{value:.4g}"


def _of(name: str, text: str, message: str) -> Problem:
    return Problem(f"parameters.{name}", line_of(text, ("parameters", name)), message)
