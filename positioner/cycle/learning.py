"""What a cycle learns, and what it believes of what others have learned: nothing that physics excludes. Pure."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.cycle.events import Event, Learned
from positioner.cycle.trust_events import NotBelieved
from positioner.valve.credible import Limits, credible_part

if TYPE_CHECKING:
    from positioner.cycle.state import CycleState, Setup
    from positioner.valve.stiction import LearnedSample


def believe(setup: Setup, state: CycleState, events: list[Event]) -> CycleState:
    """Return the state with the credible part of its table, where that comes from outside; told once for each table."""
    if state.table is state.believed:
        return state
    table, excluded = credible_part(_limits(setup), state.table)
    if excluded:
        first = excluded[0]
        events.append(NotBelieved(first, *_range(setup, first, table.cell_width_m), len(excluded), taught=False))
    return replace(state, table=table, believed=table)


def learn(setup: Setup, state: CycleState, lessons: tuple[LearnedSample, ...], events: list[Event]) -> CycleState:
    """Return the state with the law's `lessons`; without them in the law's first cycle, and while no command acts."""
    if not setup.learns or state.stem is None or not state.effect.teaches or state.guard.foreign_ns is not None:
        return state
    table = state.table
    for sample in lessons:
        low, high = _range(setup, sample, table.cell_width_m)
        if not low <= sample.value <= high:
            events.append(NotBelieved(sample, low, high, 1, taught=True))
            continue
        table = table.record(sample.quantity, sample.position_m, sample.direction, sample.value)
        events.append(Learned(sample, table.sequence))
    if table is state.table:
        return state
    return replace(state, table=table, believed=table)


def _limits(setup: Setup) -> Limits:
    return setup.limits or Limits(setup.valve)


def _range(setup: Setup, sample: LearnedSample, cell_width_m: float) -> tuple[float, float]:
    return _limits(setup).range_of(sample.quantity, sample.position_m, sample.direction, cell_width_m / 2.0)
