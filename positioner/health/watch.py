"""What is watched in each cycle: moves, friction, ends, deviation, a stem that is stuck or hunts; and the alarms. Pure.

Everything follows from the instant, the position, the current that acted and the setpoint of each cycle, so that a
record gives the same digits as the live valve.
"""

from __future__ import annotations

import math
from dataclasses import field
from typing import TYPE_CHECKING, Final

from positioner.health.alarms import Alarm, Changed, Watched, judged
from positioner.health.causes import AlarmCause, Limits
from positioner.health.friction_trend import Changes, FrictionTrend, after_move, changes
from positioner.health.friction_watched import friction_watched
from positioner.health.moves import MoveTracker, follow
from positioner.health.pressure import Pressure, PressureSettings, acted_ma
from positioner.health.reference import CONFIGURED, Reference
from positioner.health.stress import stress
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.cycle.hunting import Hunting
    from positioner.health.counters import Counters
    from positioner.health.move import Move, MoveSettings
    from positioner.health.observed import ObservedCycle
    from positioner.health.settings import HealthTable

_JUDGED_EVERY_US: Final = 500_000
_NEAR_END = 0.05
"""Of the span: a stem so near to a stop may stand on it."""
_AT_END = 0.02
"""Of the span: a move that ends so near to a stop may have struck it."""
_PRESSED = 1.5
"""Of F_s: a stem that rests under more force stands on a stop, or is stuck."""
_NEWEST_END = 0.2
"""The weight of the newest closing in the mean end position."""
_MOST_FRICTION = 4.0
_NEXT_PERIOD: Final = 1.5
_MOST_PERIODS: Final = 1000
"""After so long a gap nothing is known of the pressure."""


NO_STROKE_TEST = Watched(AlarmCause.STROKE_TEST, 0.0, 0.0, "none is kept")


@dataclass(frozen=True, slots=True)
class WatchSettings:
    """What the watch knows: how moves and pressure are measured, the reference, λ, and the limits by cause.

    wear: the part of the packing's life that a cycle of each class takes, empty where nobody knows.
    response, stroke_test: what the kept results of these tests show; stroke_test_due_s: the time from the start until
    another stroke test is due.
    testing: a test procedure is in the place of the law, and no setpoint is pursued.
    """

    moves: MoveSettings
    pressure: PressureSettings
    reference: Reference
    averaging: float
    limits: Mapping[AlarmCause, Limits]
    cycle_limit: float
    travel_limit_m: float
    wear: tuple[float, ...] = ()
    response: Watched | None = None
    stroke_test: Watched = NO_STROKE_TEST
    stroke_test_due_s: float = math.inf
    testing: bool = False

    @classmethod
    def of(
        cls, moves: MoveSettings, pressure: PressureSettings, reference: Reference, settings: HealthTable
    ) -> WatchSettings:
        """Return the settings of a configured valve."""
        limits = {cause: settings.limits_of(cause) for cause in AlarmCause}
        travel_m = settings.travel_limit * reference.span_m
        return cls(
            moves, pressure, reference, settings.averaging, limits, settings.cycle_limit, travel_m, settings.wear
        )


@dataclass(frozen=True, slots=True)
class Trends:
    """What is kept from one start to the next.

    against: source and date of the reference.
    closed, open: how far the stem rested from the closed and the open stop, as parts of the span; closings, openings:
    how often.
    alarms: by cause; their instants are seconds of operation.
    """

    against: tuple[str, str] = (CONFIGURED, "")
    friction: FrictionTrend = field(default_factory=FrictionTrend)
    closed: float = 0.0
    closings: int = 0
    open: float = 0.0
    openings: int = 0
    alarms: tuple[Alarm, ...] = ()


@dataclass(slots=True)
class Watch:
    """The trends, and what is under way. `watch_cycle` changes it in place.

    changed: what happened to the alarms in the last cycle. begin_us: the instant of the first cycle, -1 before it;
        others are counted from there, so that their roundings are those of a log, too.
    last_us, judged_us: of the last reading and judgement.
    """

    trends: Trends = field(default_factory=Trends)
    tracker: MoveTracker = field(default_factory=MoveTracker)
    pressure: Pressure = field(default_factory=Pressure)
    changed: tuple[Changed, ...] = ()
    begin_us: int = -1
    last_us: int = -1
    judged_us: int = -1


def watch_cycle(settings: WatchSettings, watch: Watch, cycle: ObservedCycle, counters: Counters) -> None:
    """Take in a cycle; `counters` has all before it. Where no current is known to act, a move under way is lost."""
    watch.changed = ()
    if watch.begin_us < 0:
        watch.begin_us = cycle.now_us
    position_m, applied_ma = cycle.position_m, cycle.applied_ma
    if position_m is None:
        return
    moved, now_us = False, cycle.now_us - watch.begin_us
    if applied_ma is None:
        watch.tracker, watch.pressure, watch.last_us = MoveTracker(), Pressure(), -1
    else:
        period_s = settings.moves.period_s
        late = (now_us - watch.last_us) * 1e-6 / period_s
        periods = 1 if watch.last_us < 0 or late < _NEXT_PERIOD else round(late)
        watch.last_us = now_us
        if periods > _MOST_PERIODS:
            watch.tracker, watch.pressure, periods = MoveTracker(), Pressure(), 1
        applied_ma = acted_ma(settings.pressure, watch.pressure, applied_ma, cycle.pressure_pa, periods)
        move = follow(settings.moves, watch.tracker, now_us * 1e-6, periods * period_s, position_m, applied_ma)
        if move is not None:
            moved = True
            _add_move(settings, watch, move)
    if not moved and 0 <= now_us - watch.judged_us < _JUDGED_EVERY_US:
        return
    watch.judged_us = now_us
    setpoint_m = None if settings.testing or cycle.controlled is None else cycle.controlled.setpoint_m
    watched = _watched(settings, watch, position_m, applied_ma, setpoint_m)
    watched.append(_hunting(settings, cycle.hunting))
    watched += _counted(settings, counters, now_us * 1e-6)
    now_s = counters.total_us * 1e-6
    alarms, watch.changed = judged(watch.trends.alarms, settings.limits, watched, now_s)
    if alarms or watch.trends.alarms:
        watch.trends = replace(watch.trends, alarms=alarms)


def _add_move(settings: WatchSettings, watch: Watch, move: Move) -> None:
    trends, reference = watch.trends, settings.reference
    balance_n, pressed_n = reference.balance_n(move.before_m), _PRESSED * reference.static_n
    closed = (move.before_m - reference.closed_m) / reference.span_m
    opened = (move.before_m - reference.open_m) / reference.span_m
    if abs(closed) < _NEAR_END and move.lowest_n < balance_n - pressed_n:
        count = trends.closings + 1
        mean = trends.closed + max(_NEWEST_END, 1.0 / count) * (closed - trends.closed)
        trends = replace(trends, closed=mean, closings=count)
    if abs(opened) < _NEAR_END and move.highest_n > balance_n + pressed_n:
        count = trends.openings + 1
        mean = trends.open + max(_NEWEST_END, 1.0 / count) * (opened - trends.open)
        trends = replace(trends, open=mean, openings=count)
    lands_m = min(abs(move.after_m - reference.closed_m), abs(move.after_m - reference.open_m))
    if lands_m > _AT_END * reference.span_m:  # a stop would take energy that counts as friction
        trends = replace(trends, friction=after_move(trends.friction, reference, settings.averaging, move))
    watch.trends = trends


def changes_of(settings: WatchSettings, trends: Trends) -> Changes:
    """Return what has changed since the reference."""
    return changes(trends.friction, settings.reference, settings.averaging)


def _watched(
    settings: WatchSettings, watch: Watch, position_m: float, applied_ma: float | None, setpoint_m: float | None
) -> list[Watched]:
    """Return the values of the causes that this cycle shows."""
    reference, trends = settings.reference, watch.trends
    changed = changes_of(settings, trends)
    deviation = 0.0 if setpoint_m is None else abs(setpoint_m - position_m) / reference.span_m
    found = [Watched(AlarmCause.TRAVEL_DEVIATION, deviation, 0.0, f"the stem stands at {position_m * 1e3:.2f} mm")]
    found.append(_stuck(settings, watch.tracker, applied_ma, changed.friction.value))
    found += _ends(trends)
    if reference.source != CONFIGURED and trends.friction.moves:
        found += friction_watched(changed, trends.friction)
    return found


def _ends(trends: Trends) -> list[Watched]:
    """Return the end positions, one value for both: the one that has moved farther."""
    if not (trends.closings or trends.openings):
        return []
    at, count, name = max((abs(trends.closed), trends.closings, "closed"), (abs(trends.open), trends.openings, "open"))
    return [Watched(AlarmCause.END_POSITION, at, 0.0, f"the {name} end, seen {count} times")]


def _counted(settings: WatchSettings, counters: Counters, running_s: float) -> list[Watched]:
    """Return counts as parts of their limits, and what the kept results of test procedures show."""
    cycles, travel_m = counters.cycles / settings.cycle_limit, counters.travel_m / settings.travel_limit_m
    what = f"{counters.cycles} cycles"
    if settings.wear and (spent := stress(settings.wear, counters.spans)) > cycles:
        cycles, what = spent, f"{counters.cycles} cycles, by their spans"
    stroke_test = settings.stroke_test
    if stroke_test.value == 0.0 and running_s > settings.stroke_test_due_s:
        stroke_test = Watched(AlarmCause.STROKE_TEST, 1.0, 0.0, "overdue")
    found = [
        Watched(AlarmCause.CYCLES, cycles, 0.0, what),
        Watched(AlarmCause.TRAVEL, travel_m, 0.0, f"{counters.travel_m:.1f} m"),
        stroke_test,
    ]
    return found if settings.response is None else [*found, settings.response]


def _hunting(settings: WatchSettings, hunting: Hunting | None) -> Watched:
    """Return how far a stem that hunts swings, of the span; 0 of one that does not."""
    if hunting is None or not hunting.swings.told:
        return Watched(AlarmCause.HUNTING, 0.0)
    swings, span_m = hunting.swings, settings.reference.span_m
    what = f"{swings.count} reversals in {hunting.swung_s:.1f} s around {swings.setpoint_m * 1e3:.1f} mm"
    return Watched(AlarmCause.HUNTING, swings.mean_m / span_m, 0.0, what)


def _stuck(settings: WatchSettings, tracker: MoveTracker, applied_ma: float | None, friction: float) -> Watched:
    """Return the force beyond the spring's on a stem that rests, over the friction that it has now.

    friction: its change against the reference.
    """
    reference, ratio = settings.reference, 0.0
    if applied_ma is not None and not tracker.moving and tracker.count > 0:
        static_n = reference.static_at_n(tracker.rest_m) * min(max(1.0 + friction, 1.0), _MOST_FRICTION)
        push_n = settings.moves.gain_n_per_ma * applied_ma - reference.balance_n(tracker.rest_m)
        stop_m = reference.open_m if push_n > 0.0 else reference.closed_m
        if math.copysign(1.0, push_n) * (stop_m - tracker.rest_m) > _NEAR_END * reference.span_m:
            ratio = abs(push_n) / static_n
    return Watched(AlarmCause.STUCK, ratio, 0.0, f"at {tracker.rest_m * 1e3:.2f} mm")
