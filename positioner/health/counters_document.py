"""The counters as plain values, for the saved document and for programs. Pure."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from positioner.health.classes import DEVIATION_EDGES_PERCENT, RECENT, TRAVEL_EDGES_PERCENT
from positioner.health.counters import Counters
from positioner.health.plain_values import plain, value_like
from positioner.health.turns import Turns
from positioner.values import replace

COUNTERS = "counters"
"""The name of the section."""
_TURNS = ("turns", "cycle_turns")
_RECENT = {"travel_recent": len(TRAVEL_EDGES_PERCENT), "deviation_recent": len(DEVIATION_EDGES_PERCENT)}
"""The highest class of each."""


def counters_in(counters: Counters) -> dict[str, Any]:
    """Return the section of these counters."""
    section = {name: plain(getattr(counters, name)) for name in NAMES}
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
    if not isinstance(section, dict) or not set(NAMES) - _NEWER <= set(section) - _OLDER <= set(NAMES):
        raise ValueError("the counters are not as this version writes them")
    own = ((name, each) for name, each in section.items() if name not in _OLDER)
    return replace(none, **{name: _value(name, getattr(none, name), each) for name, each in own})


NAMES = tuple(each.name for each in fields(Counters))
_NEWER = {"checked_us", "travel_recent", "deviation_recent"}
"""What earlier versions did not write."""
_OLDER = {"table_moves"}
"""What only earlier versions wrote; it is not read."""


def _value(name: str, example: Any, given: Any) -> Any:
    """Return what was written as `given`; what is not yet known is None."""
    if name in _RECENT:
        return _recent(name, given)
    if example is not None:
        return value_like(name, example, given)
    if given is None:
        return None
    return _turns(name, given) if name in _TURNS else value_like(name, 0.0, given)


def _recent(name: str, given: Any) -> tuple[int, ...]:
    if not isinstance(given, list) or len(given) > RECENT:
        raise ValueError(f"{name} is no row of {RECENT} classes at most")
    if not all(type(each) is int and 0 <= each <= _RECENT[name] for each in given):
        raise ValueError(f"{name} has a class that is none")
    return tuple(given)


def _turns(name: str, given: Any) -> Turns:
    match given:
        case [float(turned_m), float(farthest_m), int(direction)] if direction in {-1, 0, 1}:
            return Turns(turned_m, farthest_m, direction)
    raise ValueError(f"{name} is no turning point")
