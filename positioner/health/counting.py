"""Counting: what each observed cycle adds to the counters of a valve. Pure.

Positions are counted as means of short stretches of readings, whose noise is a fraction of a reading's. So noise alone
never leaves a dead band of 4 σ, which the single readings of a year leave often.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from positioner.cycle.events import MoveBegan
from positioner.cycle.trust_events import PushFailed
from positioner.health.classes import (
    DEVIATION_EDGES_PERCENT,
    SPAN_EDGES_PERCENT,
    TRAVEL_EDGES_PERCENT,
    class_of,
    counted,
    with_newest,
)
from positioner.health.turns import Turns
from positioner.values import dataclass, replace
from positioner.wire.messages import Mode

if TYPE_CHECKING:
    from positioner.health.counters import Counters, CounterSettings
    from positioner.health.observed import ObservedCycle

STRETCH_S: Final = 0.1
LEAST_READINGS: Final = 16
"""A stretch is so long, and has at least so many readings."""
_STRETCH_US: Final = 100_000
_SAMPLE_US: Final = 1_000_000
_CLOSED_PERCENT, _NEAR_CLOSED_PERCENT, _OPEN_PERCENT = 0.5, 5.0, 99.5


@dataclass(slots=True)
class Counting:
    """The counters, and what is not yet in them. `count` changes them in place.

    observed: cycles. readings, sum_m: of the present stretch, their number and sum.
    timed_us: the instant up to which time is counted, -1 before the first cycle; sampled_us: that of the last sample
        of the histograms. mode, stuck: since then; stuck is None where no law knows.
    percent: where the stem was, NaN where unknown.
    """

    counters: Counters
    observed: int
    readings: int = 0
    sum_m: float = 0.0
    timed_us: int = -1
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


def count(settings: CounterSettings, after: Counting, cycle: ObservedCycle) -> None:
    """Count one more cycle. It is called in each, so what can wait for the end of a stretch does."""
    controlled, mode, now_us, position_m = cycle.controlled, cycle.mode, cycle.now_us, cycle.position_m
    after.observed += 1
    stuck: bool | None = None
    if controlled is not None and not settings.testing:  # a procedure estimates no stem
        stuck = controlled.stem.stuck
    elif position_m is None and mode is after.mode:
        stuck = after.stuck  # a cycle between two readings
    if after.timed_us < 0:
        after.timed_us = after.sampled_us = now_us
        after.mode, after.stuck = mode, stuck
    if now_us - after.timed_us >= _STRETCH_US or stuck is not after.stuck or mode is not after.mode:
        _pass_time(settings, after, now_us)
        _switch(after, stuck)
        after.mode = mode
    if len(cycle.events) > 1 or (controlled is None and cycle.events):
        _add_events(after, cycle)
    if position_m is not None:
        after.readings += 1
        after.sum_m += position_m
        if after.readings >= LEAST_READINGS and after.readings * settings.sample_period_s >= STRETCH_S:
            _add_position(settings, after, after.sum_m / after.readings, cycle)
            after.readings, after.sum_m = 0, 0.0


def _pass_time(settings: CounterSettings, after: Counting, now_us: int) -> None:
    """Count the time up to this cycle under what held before it."""
    passed_us, counters, percent = now_us - after.timed_us, after.counters, after.percent
    checked_us, mode_us = counters.checked_us, counters.mode_us
    if settings.testing and after.mode is Mode.ACTIVE:
        checked_us += passed_us
    else:
        mode_us = tuple([each + passed_us if mode == after.mode else each for mode, each in enumerate(mode_us)])
    after.counters = replace(
        counters,
        mode_us=mode_us,
        checked_us=checked_us,
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
            after.counters = replace(counters, moves=counters.moves + 1)
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
    travel_recent, deviation_recent = counters.travel_recent, counters.deviation_recent
    if cycle.now_us - after.sampled_us >= _SAMPLE_US:
        after.sampled_us += (cycle.now_us - after.sampled_us) // _SAMPLE_US * _SAMPLE_US
        travel = counted(travel, TRAVEL_EDGES_PERCENT, after.percent)
        travel_recent = with_newest(travel_recent, class_of(TRAVEL_EDGES_PERCENT, after.percent))
        if cycle.controlled is not None and not settings.testing:  # a procedure pursues no setpoint
            error_percent = 100.0 * (cycle.controlled.setpoint_m - position_m) / settings.span_m
            deviation = counted(deviation, DEVIATION_EDGES_PERCENT, error_percent)
            deviation_recent = with_newest(deviation_recent, class_of(DEVIATION_EDGES_PERCENT, error_percent))
    after.counters = replace(
        counters,
        travel_m=counters.travel_m + (way_m if is_travel else 0.0),
        reversals=counters.reversals + int(span_m is not None),
        cycles=counters.cycles + int(cycle_span_m is not None),
        travel=travel,
        deviation=deviation,
        spans=spans,
        travel_recent=travel_recent,
        deviation_recent=deviation_recent,
        anchor_m=position_m if is_travel else anchor_m,
        turns=turns,
        cycle_turns=cycle_turns,
    )
