"""Several valves in one file: each `[[valve]]` with its own tables over the shared ones, and where two clash. Pure."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any

from positioner.errors import Problem
from positioner.inputs.toml_lines import line_of
from positioner.inputs.toml_reader import laid_over
from positioner.wire.settings import ID_OFFSETS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from positioner.config.schema import Configuration


_OF_THE_VALVE = frozenset({"actuator"})
"""Tables in a `[[valve]]` that belong to the valve itself, as in `[valve]`; the others are as at the top."""


@dataclass(frozen=True, slots=True)
class Section:
    """One `[[valve]]`: its name for messages, the tables in it, and all tables, as if the file had no other valve."""

    name: str
    own: Mapping[str, Any]
    tables: dict[str, Any]


def sections_of(tables: Mapping[str, Any]) -> tuple[Section, ...]:
    """Return each `[[valve]]` of a file. A table in it is laid over the one of that name at the top, key by key."""
    shared = {key: value for key, value in tables.items() if key != "valve"}
    return tuple(_section(number, element, shared) for number, element in enumerate(tables["valve"], start=1))


def _section(number: int, element: Any, shared: Mapping[str, Any]) -> Section:
    if not isinstance(element, dict):
        return Section(f"number {number}", {}, {**shared, "valve": element})
    own = {key: value for key, value in element.items() if isinstance(value, dict) and key not in _OF_THE_VALVE}
    valve = {key: value for key, value in element.items() if key not in own}
    name = str(valve.get("id", f"number {number}"))
    return Section(name, {**own, "valve": valve}, {**deepcopy(laid_over(shared, own)), "valve": valve})


def placed(sections: Sequence[Section], mistakes: Sequence[Sequence[Problem]], text: str) -> tuple[Problem, ...]:
    """Return the mistakes of each section with their lines and the valve's name; once, where every valve has it."""
    everyones = set.intersection(*map(set, mistakes)) if mistakes else set()
    found = []
    for number, (section, problems) in enumerate(zip(sections, mistakes, strict=True)):
        for problem in problems:
            key, _, _ = problem.where.partition(" = ")
            path = tuple(key.split("."))
            own = _depth(section.own, path)
            if own and own >= _depth(section.tables, path):
                in_section = path if path[0] == "valve" else ("valve", *path)
                line = line_of(text, in_section, number)
            else:
                line = line_of(text, path)
                if problem in everyones:
                    found.append(replace(problem, line=line))
                    continue
            found.append(_named(section.name, problem, line))
    return in_order(found)


def _depth(tables: Any, path: tuple[str, ...]) -> int:
    """Return how many parts of the key `path` stand in the nested tables."""
    depth = 0
    for part in path:
        if not isinstance(tables, dict) or part not in tables:
            break
        tables, depth = tables[part], depth + 1
    return depth


def _named(name: str, problem: Problem, line: int | None) -> Problem:
    return replace(problem, where=f"valve {name}: {problem.where.removeprefix('valve.')}", line=line)


def in_order(problems: Sequence[Problem]) -> tuple[Problem, ...]:
    """Return the mistakes by their lines, each once."""
    return tuple(sorted(dict.fromkeys(problems), key=lambda problem: problem.line or 0))


def by_bus(found: Sequence[Configuration]) -> tuple[tuple[Configuration, ...], ...]:
    """Return the valves of each bus."""
    places = dict.fromkeys(each.bus.place for each in found)
    return tuple(tuple(each for each in found if each.bus.place == place) for place in places)


def clashes(sections: Sequence[Configuration | None], text: str) -> tuple[Problem, ...]:
    """Return where two valves clash: by their id, or on one bus by an identifier or by its options.

    A section with a mistake of its own is None.
    """
    problems = []
    numbered = [(number, each) for number, each in enumerate(sections) if each is not None]
    found = [each for _, each in numbered]
    for (_, first), (number, second) in combinations(numbered, 2):
        name, other = second.valve.id, first.valve.id
        if name == other:
            line = line_of(text, ("valve", "id"), number)
            problems.append(
                Problem(f"valve {name}: id", line, "is another valve's: each needs its own, as its state does")
            )
        elif first.bus.place == second.bus.place:
            if first.bus.options != second.bus.options:
                line = line_of(text, ("valve", "bus", "options"), number)
                message = f"differ from those of {other}, which is on the same bus"
                problems.append(Problem(f"valve {name}: bus.options", line, message))
            if message := _shared_identifier(first, second, found):
                line = line_of(text, ("valve", "wire"), number)
                problems.append(Problem(f"valve {name}: wire", line, message))
    return in_order(problems)


def _shared_identifier(first: Configuration, second: Configuration, all_of_them: Sequence[Configuration]) -> str:
    """Return the first identifier that two valves on one bus share, in words; empty where they share none."""
    one, other = first.make_codec(), second.make_codec()
    shared = sorted(one.by_id.keys() & other.by_id.keys())
    if not shared:
        return ""
    mine, theirs = other.by_id[shared[0]], one.by_id[shared[0]]
    used = {each.wire.id_offset for each in all_of_them if each.bus.place == second.bus.place}
    free = next((offset for offset in ID_OFFSETS if offset not in used), None)
    advice = "put it on another bus" if free is None else f"try wire.id_offset = {free}"
    if mine.data_id is None or theirs.data_id is None:
        advice = "each valve needs messages of its own in the DBC"
    what = f"{mine.dbc.name} has the identifier {shared[0][0]:X} of {first.valve.id}'s {theirs.dbc.name}"
    return f"{what} on bus {first.bus}; {advice}"
