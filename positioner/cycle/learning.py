"""What a cycle learns, and what it uses of a table from outside: nothing that physics excludes. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.cycle.events import Event, Learned
from positioner.cycle.trust_events import NotBelieved
from positioner.valve.credible import Limits, credible_part

if TYPE_CHECKING:
    from positioner.cycle.state import CycleState, Setup
    from positioner.valve.stiction import LearnedSample, StictionTable


def credible(setup: Setup, state: CycleState, events: list[Event]) -> StictionTable:
    """Return the credible part of the table; a table from outside is checked, and what is excluded is reported."""
    if state.table is state.credible_table:
        return state.table
    table, excluded = credible_part(Limits(setup.valve), state.table)
    if excluded:
        first = excluded[0]
        events.append(NotBelieved(first, *_range(setup, first, table.cell_width_m), len(excluded), taught=False))
    return table


def learn(
    setup: Setup, state: CycleState, table: StictionTable, lessons: tuple[LearnedSample, ...], events: list[Event]
) -> StictionTable:
    """Return the table with the law's `lessons`; without them where commands that are not ours may have acted."""
    if not setup.learns or not state.effect.teaches or state.guard.last.foreign_ns is not None:
        return table
    for sample in lessons:
        low, high = _range(setup, sample, table.cell_width_m)
        if not low <= sample.value <= high:
            events.append(NotBelieved(sample, low, high, 1, taught=True))
            continue
        table = table.learned(sample)
        events.append(Learned(sample, table.sequence))
    return table


def _range(setup: Setup, sample: LearnedSample, cell_width_m: float) -> tuple[float, float]:
    return Limits(setup.valve).range_of(sample.quantity, sample.position_m, sample.direction, cell_width_m / 2.0)
