"""What changes in a plant at given instants: sudden sticking, a supply that drops, a zero that drifts away. Pure.

A change replaces one parameter. It acts at its instant, however the time is divided into steps. A drift is made of
equal small changes, so that the motion between them keeps its closed form.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from positioner.values import dataclass

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings, ScheduledChange

_ROUNDING_S = 1e-9
"""A change this close to the end of a step belongs to the next step, however the instants were rounded."""

_DRIFT_STEPS = 100
"""Of a drift. It is never farther than half a step from the straight line."""


@dataclass(frozen=True, slots=True)
class Change:
    """At `at_s` the parameter `key` takes `value`."""

    at_s: float
    key: str
    value: float


@dataclass(frozen=True, slots=True)
class Stretch:
    """The settings that act for `duration_s`; before: those before them, where a change begins the stretch."""

    settings: PlantSettings
    duration_s: float
    before: PlantSettings | None = None


class _Latest:
    """The timeline that was wanted last: instants in s, and the settings from each of them on."""

    settings: ClassVar[PlantSettings | None] = None
    instants_s: ClassVar[list[float]] = []
    acting: ClassVar[list[PlantSettings]] = []


def changes(settings: PlantSettings) -> tuple[Change, ...]:
    """Return every change of the schedule, oldest first; a drift is its steps."""
    found: list[Change] = []
    for each, before, after in _ends(settings):
        if each.over_s == 0.0:
            found.append(Change(each.at_s, each.key, after))
            continue
        for number in range(1, _DRIFT_STEPS + 1):
            at_s = each.at_s + each.over_s * (number - 0.5) / _DRIFT_STEPS
            found.append(Change(at_s, each.key, before + (after - before) * number / _DRIFT_STEPS))
    return tuple(sorted(found, key=lambda change: change.at_s))


def begun(settings: PlantSettings, start_s: float, end_s: float) -> tuple[str, ...]:
    """Return a line for each scheduled change that begins from `start_s` on, and before `end_s`."""
    return tuple(
        f"at {each.at_s:g} s: {each.key} from {before:g} to {after:g}"
        + (f", over {each.over_s:g} s" if each.over_s else "")
        for each, before, after in _ends(settings)
        if start_s - _ROUNDING_S <= each.at_s < end_s - _ROUNDING_S
    )


def _ends(settings: PlantSettings) -> list[tuple[ScheduledChange, float, float]]:
    """Return the scheduled changes, oldest first, each with the value before it and the value after it."""
    found: list[tuple[ScheduledChange, float, float]] = []
    latest: dict[str, float] = {}
    for each in sorted(settings.schedule, key=lambda change: change.at_s):
        table, name = each.key.split(".")
        before = latest.get(each.key, getattr(getattr(settings, table), name))
        after = each.factor * before if each.value is None and each.factor is not None else each.value
        assert after is not None  # noqa: S101 - a change has either of them
        latest[each.key] = after
        found.append((each, before, after))
    return found


def every_settings(settings: PlantSettings) -> list[PlantSettings]:
    """Return all settings that act at some time, oldest first; they have no schedule any more."""
    if _Latest.settings is not settings:
        instants_s, acting_ones = [-math.inf], [replace(settings, schedule=())]
        for change in changes(settings):
            table, name = change.key.split(".")
            before = acting_ones[-1]
            after = replace(getattr(before, table), **{name: change.value})
            instants_s.append(change.at_s)
            acting_ones.append(replace(before, **{table: after}))
        _Latest.settings, _Latest.instants_s, _Latest.acting = settings, instants_s, acting_ones
    return _Latest.acting


def acting(settings: PlantSettings, time_s: float) -> PlantSettings:
    """Return the settings that act at `time_s`."""
    if not settings.schedule:
        return settings
    acting_ones = every_settings(settings)
    return acting_ones[bisect_right(_Latest.instants_s, time_s + _ROUNDING_S) - 1]


def stretches(settings: PlantSettings, start_s: float, duration_s: float) -> list[Stretch]:
    """Return what acts for `duration_s` from `start_s` on."""
    end_s = start_s + duration_s
    acting_ones = every_settings(settings)
    instants_s = _Latest.instants_s
    first = bisect_left(instants_s, start_s - _ROUNDING_S)
    last = bisect_left(instants_s, end_s - _ROUNDING_S)
    begins_s = [start_s, *(max(at_s, start_s) for at_s in instants_s[first:last]), end_s]
    found = [Stretch(acting_ones[first - 1], begins_s[1] - begins_s[0])]
    for number in range(first, last):
        here = number - first + 1
        found.append(Stretch(acting_ones[number], begins_s[here + 1] - begins_s[here], acting_ones[number - 1]))
    return found
