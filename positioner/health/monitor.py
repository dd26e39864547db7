"""The health of one valve: each part of it is computed from the same observed cycles, live and from a log. Pure.

A saved document has one section for each part, by its name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.health.counters_document import COUNTERS, counters_from, counters_in
from positioner.health.counting import Counting, begin, count
from positioner.health.trends_document import TRENDS, trends_from, trends_in
from positioner.health.watch import Watch, watch_cycle
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.health.counters import CounterSettings
    from positioner.health.observed import ObservedCycle
    from positioner.health.watch import WatchSettings


@dataclass(frozen=True, slots=True)
class HealthSettings:
    """What health knows of the valve."""

    counters: CounterSettings
    watch: WatchSettings


@dataclass(frozen=True, slots=True)
class HealthState:
    """What health carries on from cycle to cycle; `begin_us` is the instant of the first one, None before it.

    Each part gets its instants from there: then their roundings are those of a log, too.
    """

    counting: Counting
    watch: Watch
    begin_us: int | None = None


def begin_health(settings: HealthSettings, sections: Mapping[str, Any]) -> HealthState:
    """Return the health of a positioner that starts, from the sections that were kept.

    Raises:
        ValueError: a section is not as it was written.
    """
    trends = trends_from(sections.get(TRENDS), settings.watch.reference)
    return HealthState(begin(counters_from(sections.get(COUNTERS))), Watch(trends))


def observe(settings: HealthSettings, health: HealthState, cycle: ObservedCycle) -> HealthState:
    """Return the health after one more cycle; the watch is changed in place."""
    begin_us = cycle.now_us if health.begin_us is None else health.begin_us
    cycle = replace(cycle, now_us=cycle.now_us - begin_us)
    counting = count(settings.counters, health.counting, cycle)
    watch_cycle(settings.watch, health.watch, cycle, counting.counters)
    return HealthState(counting, health.watch, begin_us)


def sections_of(health: HealthState) -> dict[str, Any]:
    """Return the sections to keep, as `json.dumps` takes them."""
    return {COUNTERS: counters_in(health.counting.so_far), TRENDS: trends_in(health.watch.trends)}
