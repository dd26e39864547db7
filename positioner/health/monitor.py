"""The health of one valve: each part of it is computed from the same observed cycles, live and from a log. Pure.

A saved document has one section for each part, by its name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.health.counters_document import COUNTERS, counters_from, counters_in
from positioner.health.counting import Counting, begin, count
from positioner.health.observed import observed_cycle
from positioner.health.trends_document import TRENDS, trends_from, trends_in
from positioner.health.watch import Watch, watch_cycle
from positioner.values import dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.cycle.events import Event
    from positioner.cycle.input import CycleInput
    from positioner.cycle.state import CycleState
    from positioner.health.counters import CounterSettings
    from positioner.health.observed import ObservedCycle
    from positioner.health.watch import WatchSettings
    from positioner.wire.messages import CanFrame


@dataclass(frozen=True, slots=True)
class HealthSettings:
    """What health knows of the valve."""

    counters: CounterSettings
    watch: WatchSettings


@dataclass(frozen=True, slots=True)
class HealthState:
    """What health carries on from cycle to cycle; each cycle changes both parts in place."""

    counting: Counting
    watch: Watch


def begin_health(settings: HealthSettings, sections: Mapping[str, Any]) -> HealthState:
    """Return the health of a positioner that starts, from the sections that were kept.

    Raises:
        ValueError: a section is not as it was written.
    """
    trends = trends_from(sections.get(TRENDS), settings.watch.reference)
    return HealthState(begin(counters_from(sections.get(COUNTERS))), Watch(trends))


def check_sections(sections: Mapping[str, Any]) -> None:
    """Check that the sections that were kept can be gone on from, whatever the reference is.

    Raises:
        ValueError: a section is not as it was written.
    """
    counters_from(sections.get(COUNTERS))
    trends_from(sections.get(TRENDS), None)


def observe(settings: HealthSettings, health: HealthState, cycle: ObservedCycle) -> bool:
    """Take in one more cycle; return whether a tenth of a second is over or an alarm has changed: time to look."""
    counting, watch = health.counting, health.watch
    timed_us = counting.timed_us
    count(settings.counters, counting, cycle)
    watch_cycle(settings.watch, watch, cycle, counting.counters)
    return counting.timed_us != timed_us or bool(watch.changed)


def observe_step(
    settings: HealthSettings,
    health: HealthState,
    cycle_input: CycleInput,
    before: CycleState,
    after: CycleState,
    outbox: tuple[CanFrame, ...],
    events: tuple[Event, ...],
) -> bool:
    """Take in what `step` made of a cycle, as `observe`: one call for each cycle of the daemon."""
    cycle = observed_cycle(cycle_input, before, after, outbox, events)
    return cycle is not None and observe(settings, health, cycle)


def sections_of(health: HealthState) -> dict[str, Any]:
    """Return the sections to keep, as `json.dumps` takes them."""
    return {COUNTERS: counters_in(health.counting.so_far), TRENDS: trends_in(health.watch.trends)}
