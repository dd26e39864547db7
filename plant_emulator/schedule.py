"""What changes in a plant at given instants: sudden sticking, a supply that drops, a shifted zero. Pure.

A change replaces one parameter. It acts at its instant, however the time is divided into steps.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings

_ROUNDING_S = 1e-9
"""A change this close to the end of a step belongs to the next step, however the instants were rounded."""


class _Latest:
    """The timeline that was wanted last."""

    settings: ClassVar[PlantSettings | None] = None
    timeline: ClassVar[tuple[tuple[float, PlantSettings], ...]] = ()


def timeline(settings: PlantSettings) -> tuple[tuple[float, PlantSettings], ...]:
    """Return the settings that act from each instant in s on, oldest first; they have no schedule any more."""
    if _Latest.settings is not settings:
        found = [(-math.inf, replace(settings, schedule=()))]
        for change in sorted(settings.schedule, key=lambda each: each.at_s):
            table, name = change.key.split(".")
            before = found[-1][1]
            after = replace(getattr(before, table), **{name: change.value})
            found.append((change.at_s, replace(before, **{table: after})))
        _Latest.settings, _Latest.timeline = settings, tuple(found)
    return _Latest.timeline


def acting(settings: PlantSettings, time_s: float) -> PlantSettings:
    """Return the settings that act at `time_s`."""
    if not settings.schedule:
        return settings
    return [each for at_s, each in timeline(settings) if at_s <= time_s + _ROUNDING_S][-1]


def stretches(settings: PlantSettings, start_s: float, duration_s: float) -> list[tuple[PlantSettings, float, bool]]:
    """Return what acts for `duration_s` from `start_s` on: (settings, seconds, whether a change begins them) each."""
    end_s = start_s + duration_s
    found = [(acting(settings, start_s), start_s, False)]
    for at_s, each in timeline(settings):
        if start_s - _ROUNDING_S <= at_s < end_s - _ROUNDING_S:
            found.append((each, max(at_s, start_s), True))
    ends_s = [begin_s for _, begin_s, _ in found[1:]] + [end_s]
    return [(each, until_s - begin_s, new) for (each, begin_s, new), until_s in zip(found, ends_s, strict=True)]
