"""Counting: what each observed cycle adds to the counters of a valve. Pure.

Positions are counted as means of short stretches of readings, whose noise is a fraction of a reading's. So noise alone
never leaves a dead band of 4 σ, which the single readings of a year leave often.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.cycle.events import MoveBegan
from positioner.cycle.trust_events import PushFailed
from positioner.health.classes import DEVIATION_EDGES_PERCENT, SPAN_EDGES_PERCENT, TRAVEL_EDGES_PERCENT, counted
from positioner.health.turns import Turns
from positioner.laws.move_reason import BreakawaySource
from positioner.values import dataclass, replace
from positioner.wire.messages import Mode

if TYPE_CHECKING:
    from positioner.health.counters import Counters, CounterSettings
    from positioner.health.observed import ObservedCycle

STRETCH_S, LEAST_READINGS = 0.1, 16
"""A stretch is so long, and has at least so many readings."""
_STRETCH_US, _SAMPLE_US = 100_000, 1_000_000
_CLOSED_PERCENT, _NEAR_CLOSED_PERCENT, _OPEN_PERCENT = 0.5, 5.0, 99.5


@dataclass(slots=True)
class Counting:
    """The counters, and what is not yet in them. `count` changes its own copy.

    observed: cycles. readings, sum_m: of the present stretch, their number and sum.
    timed_us: the instant up to which time is counted; sampled_us: that of the last sample of the histograms; None
        before the first cycle. mode, stuck: since then; stuck is None where no law knows.
    percent: where the stem was, NaN where unknown.
    """

    counters: Counters
    observed: int
    readings: int = 0
    sum_m: float = 0.0
    timed_us: int | None = None
    sampled_us: int = 0
    mode: Mode = Mode.INIT
    stuck: bool | None = None
    percent: float = math.nan

    @property
    def so_far(self) -> Counters:
        """The counters as they are to be kept."""
        return replace(self.counters, observed=self.observed)


def begin(counters: Counters) -> Counting:
    """Return the counting of a positioner that starts, from the counters that were kept."""
    return Counting(replace(counters, starts=counters.starts + 1), counters.observed)


def count(settings: CounterSettings, counting: Counting, cycle: ObservedCycle) -> Counting:
    """Return the counting with one more cycle."""
    after: Counting = replace(counting)
    after.observed += 1
    stuck = None if cycle.controlled is None else cycle.controlled.stem.stuck
    if cycle.controlled is None and cycle.position_m is None and cycle.mode is after.mode:
        stuck = after.stuck  # a cycle between two readings
    timed_us = after.timed_us
    if timed_us is None:
        after.timed_us = after.sampled_us = timed_us = cycle.now_us
        after.mode, after.stuck = cycle.mode, stuck
    if cycle.mode is not after.mode or stuck is not after.stuck or cycle.now_us - timed_us >= _STRETCH_US:
        _pass_time(after, timed_us, cycle.now_us)
        _switch(after, stuck)
        after.mode = cycle.mode
    if len(cycle.events) > 1 or (cycle.events and cycle.controlled is None):
        _add_events(after, cycle)
    if cycle.position_m is not None:
        after.readings += 1
        after.sum_m += cycle.position_m
        if after.readings >= LEAST_READINGS and after.readings * settings.sample_period_s >= STRETCH_S:
            _add_position(settings, after, after.sum_m / after.readings, cycle)
            after.readings, after.sum_m = 0, 0.0
    return after


def _pass_time(after: Counting, timed_us: int, now_us: int) -> None:
    """Count the time up to this cycle under what held before it."""
    passed_us, counters, percent = now_us - timed_us, after.counters, after.percent
    mode_us = tuple([each + passed_us if mode == after.mode else each for mode, each in enumerate(counters.mode_us)])
    after.counters = replace(
        counters,
        mode_us=mode_us,
        controlled_us=counters.controlled_us + (passed_us if after.stuck is not None else 0),
        stuck_us=counters.stuck_us + (passed_us if after.stuck else 0),
        closed_us=counters.closed_us + (passed_us if percent < _CLOSED_PERCENT else 0),
        near_closed_us=counters.near_closed_us
        + (passed_us if _CLOSED_PERCENT <= percent < _NEAR_CLOSED_PERCENT else 0),
        open_us=counters.open_us + (passed_us if percent >= _OPEN_PERCENT else 0),
    )
    after.timed_us = now_us


def _switch(after: Counting, stuck: bool | None) -> None:
    """Count the edge between sticking and sliding, where there is one."""
    if after.stuck is not None and stuck is not None and stuck is not after.stuck:
        counters = after.counters
        after.counters = (
            replace(counters, sticks=counters.sticks + 1) if stuck else replace(counters, slips=counters.slips + 1)
        )
    after.stuck = stuck


def _add_events(after: Counting, cycle: ObservedCycle) -> None:
    for event in cycle.events:
        counters = after.counters
        if isinstance(event, MoveBegan):
            from_table = event.reason.breakaway.source is BreakawaySource.TABLE
            after.counters = replace(
                counters, moves=counters.moves + 1, table_moves=counters.table_moves + int(from_table)
            )
        elif isinstance(event, PushFailed):
            after.counters = replace(counters, failed_pushes=counters.failed_pushes + 1)


def _add_position(settings: CounterSettings, after: Counting, position_m: float, cycle: ObservedCycle) -> None:
    """Count the motion to the mean position of a stretch, and sample the histograms once a second."""
    counters, after.percent = after.counters, settings.percent(position_m)
    here = Turns(position_m, position_m)
    travel_band_m = settings.dead_band_m(settings.travel_band_of_span, position_m)
    cycle_band_m = settings.dead_band_m(settings.cycle_band_of_span, position_m)
    turns, span_m = (counters.turns or here).moved(position_m, travel_band_m)
    cycle_turns, cycle_span_m = (counters.cycle_turns or here).moved(position_m, cycle_band_m)
    anchor_m = position_m if counters.anchor_m is None else counters.anchor_m
    way_m = abs(position_m - anchor_m)
    is_travel = way_m > travel_band_m
    spans = counters.spans
    if cycle_span_m is not None:
        spans = counted(spans, SPAN_EDGES_PERCENT, 100.0 * cycle_span_m / settings.span_m)
    travel, deviation = counters.travel, counters.deviation
    if cycle.now_us - after.sampled_us >= _SAMPLE_US:
        after.sampled_us += (cycle.now_us - after.sampled_us) // _SAMPLE_US * _SAMPLE_US
        travel = counted(travel, TRAVEL_EDGES_PERCENT, after.percent)
        if cycle.controlled is not None:
            error_percent = 100.0 * (cycle.controlled.setpoint_m - position_m) / settings.span_m
            deviation = counted(deviation, DEVIATION_EDGES_PERCENT, error_percent)
    after.counters = replace(
        counters,
        travel_m=counters.travel_m + (way_m if is_travel else 0.0),
        reversals=counters.reversals + int(span_m is not None),
        cycles=counters.cycles + int(cycle_span_m is not None),
        travel=travel,
        deviation=deviation,
        spans=spans,
        anchor_m=position_m if is_travel else anchor_m,
        turns=turns,
        cycle_turns=cycle_turns,
    )
