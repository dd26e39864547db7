"""The counters as plain values, for the saved document and for programs. Pure."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from positioner.health.counters import Counters
from positioner.health.turns import Turns
from positioner.values import replace

COUNTERS = "counters"
"""The name of the section."""
_TURNS = ("turns", "cycle_turns")


def counters_in(counters: Counters) -> dict[str, Any]:
    """Return the section of these counters."""
    section = {name: _plain(getattr(counters, name)) for name in NAMES}
    for name in _TURNS:
        turns: Turns | None = getattr(counters, name)
        section[name] = None if turns is None else [turns.turned_m, turns.farthest_m, turns.direction]
    return section


def counters_from(section: Any) -> Counters:
    """Return the counters in their section; None stands for one that was never written.

    Raises:
        ValueError: it is not as it was written.
    """
    none = Counters()
    if section is None:
        return none
    if not isinstance(section, dict) or set(section) != set(NAMES):
        raise ValueError("the counters are not as this version writes them")
    return replace(none, **{name: _value(name, getattr(none, name), section[name]) for name in NAMES})


NAMES = tuple(each.name for each in fields(Counters))


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _value(name: str, example: Any, given: Any) -> Any:
    """Return what was written as `given`: of the type of `example`, a histogram with as many classes."""
    if name in _TURNS:
        return None if given is None else _turns(name, given)
    if isinstance(example, tuple):
        if not isinstance(given, list) or len(given) != len(example) or not all(map(_is_count, given)):
            raise ValueError(f"{name} is no histogram of {len(example)} classes")
        return tuple(given)
    if type(example) is int:
        if not _is_count(given):
            raise ValueError(f"{name} is no count")
        return given
    if given is None and example is None:
        return None
    if type(given) is not float:
        raise ValueError(f"{name} is no number")
    return given


def _turns(name: str, given: Any) -> Turns:
    match given:
        case [float(turned_m), float(farthest_m), int(direction)] if direction in {-1, 0, 1}:
            return Turns(turned_m, farthest_m, direction)
    raise ValueError(f"{name} is no turning point")


def _is_count(given: Any) -> bool:
    return type(given) is int and given >= 0
