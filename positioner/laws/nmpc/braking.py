"""Braked moves behind a pressure that lags: when one is made, when its brake begins, and what it teaches. Pure.

A move is braked (`slip`) where its stop is sure, or where its readings say when to brake: then enough of the way must
be left once the stem is seen to move, and a setpoint that is nearer is approached from farther away. Where the valve is
not known well enough yet, moves are quasi-static.

The whole way of each move teaches (`study`). A braked stop that was missed, or a way that is not explained, makes the
next ones less sure, until it is one quasi-static move after the other; each new setpoint forgets some of that.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.belief import LAG
from positioner.laws.nmpc.judging import CERTAIN
from positioner.laws.nmpc.memory import Braked
from positioner.laws.nmpc.move import Stage, tolerance_m
from positioner.laws.nmpc.slip import numbers_of, over, shortest_m, slip_plan, steered, task_of
from positioner.laws.nmpc.study import Study, Way
from positioner.laws.nmpc.track import Doubt, Reading, Track
from positioner.values import dataclass, replace
from positioner.valve.rollout import Moving
from positioner.valve.state import StemState

if TYPE_CHECKING:
    from positioner.laws.nmpc.belief import ValveBelief
    from positioner.laws.nmpc.judging import Judge
    from positioner.laws.nmpc.memory import Move, NmpcMemory
    from positioner.laws.nmpc.move import Limits
    from positioner.laws.nmpc.programme import StopPlanner
    from positioner.laws.nmpc.slip import SlipPlan
    from positioner.laws.nmpc.stop import Task
    from positioner.laws.nmpc.study import Linear, Studied
    from positioner.valve.pressure import PressureState
    from positioner.valve.rollout import Plant
    from positioner.valve.sensor import SensorLag

_FORGIVEN = 0.7
"""Of the variance of braked stops each new setpoint forgets 30 %, so that they are tried again."""
_SURPRISE, _NEWEST = 9.0, 0.3
"""Squared miss over its variance from which on a braked stop is no longer what was believed; weight of the newest."""
_OWN, _SURE, _CLOSE = 0.0002, 0.01, 0.0003
"""Of span: the least σ of a braked stop, about what the readings of a rest show of its place; the largest one with
which it is tried; and how near it must be planned."""
_BY_READING, _SURE_BY_READING = 0.005, 0.015
"""Of span: σ of a stop that is braked by reading before one was seen, and the largest one with which it is tried."""
_MOST_OF_WAY = 0.3
"""A move that ends before 30 % of its way was stopped by something else."""
_SHOWN, _LIKELIER = 0.5, 0.5
"""Of the variance of the lag, what a way leaves that has shown it. Of the mean square that one belief leaves of a way,
what another one leaves that is believed instead: six independent blocks say that it is eight times as likely."""
_TOLERANCE, _WORTH = 0.5, 2.0
"""A braked correction needs no way there and back: it is made at half the tolerance, and beyond two of its σ."""
_HALVED = 0.5
"""Of its way: a stop that misses by more has not halved the error. A correction must exceed two σ of its stop, so none
is made again at this setpoint that is planned without a way there and back."""
_FRICTION = 0.15
"""Of F_s: what misses make the track doubt of static friction is at most what a configured one is doubted."""
_LEAST_PART = 0.0004
"""Of the rollout's variance, what is always expected to be left of a way: 2 % of its σ, less than noise shows."""
_LEAST_TIMES, _MOST_TIMES = 0.01, 100.0
"""Limits of what changes of friction may be over what is expected, as variances: a tenth and ten times."""
_ENOUGH = 4
"""Readings of a slip that say how friction changes on the way; fewer are those at which it was first seen."""
_PASSES = 3
"""Until where a move begins no longer matters: each changes its way by a small part of the change before."""
_SPARE_MA = 0.05
"""Nearer than this to a limit of the current no move is braked."""
_VISIBLE = 2.0
"""A planned way of twice what says that the stem has moved would have been seen."""
_SEEN = 10.0
"""Twice the σ of a reading, 5, that a stem must have moved to be seen."""
_FARTHER, _FARTHEST = 1.1, 0.4
"""A move that is braked by reading begins a tenth farther away than needed; beyond 40 % of span none does."""


@dataclass(frozen=True, slots=True)
class Braking:
    """The constants of one valve."""

    judge: Judge
    limits: Limits
    plant: Plant
    sensor: SensorLag
    planner: StopPlanner
    step_ma: float = math.inf

    # -- before a move

    def begun(self) -> Braked:
        """Return what is carried at the start."""
        sigma_m = _BY_READING * self.judge.valve.span_m
        return Braked(reading_m2=sigma_m * sigma_m)

    def aimed(self, memory: NmpcMemory, setpoint_m: float) -> NmpcMemory:
        """Return the memory at a new setpoint."""
        braked = memory.braked
        braked = replace(braked, planned=_FORGIVEN * braked.planned, reading_m2=_FORGIVEN * braked.reading_m2)
        return self.prepared(replace(memory, braked=braked), setpoint_m)

    def taught(self, memory: NmpcMemory) -> NmpcMemory:
        """Return the memory of a law that has read its table: the lag may be known from before a restart."""
        return replace(memory, is_lag_known=memory.belief.lag_s > 0.0 and memory.belief.is_lag_sure)

    def knows_lag(self, memory: NmpcMemory) -> bool:
        """Whether the whole way of a move has shown the lag."""
        return memory.is_lag_known and memory.belief.is_lag_sure

    def prepared(self, memory: NmpcMemory, setpoint_m: float) -> NmpcMemory:
        """Return the memory with how far away a move to a setpoint must begin to be braked by its readings."""
        up_m = down_m = 0.0
        if memory.pressure is not None and self._may_read(memory):
            up_m, down_m = (self._begins_m(memory, setpoint_m, direction) for direction in (1.0, -1.0))
        return replace(memory, braked=replace(memory.braked, from_m=(up_m, down_m)))

    def _begins_m(self, memory: NmpcMemory, setpoint_m: float, direction: float) -> float:
        """Return how far away a move in a direction must begin to be braked by its readings, 0 where it cannot.

        That depends on where it begins: near the end of the travel the pressure rises less. So it is found in passes.
        """
        belief, seen, span_m = memory.belief, self._seen_after(memory), self.judge.valve.span_m
        rollout, way_m = self.plant.rollout(numbers_of(belief.numbers.mean)), 0.0
        for _ in range(_PASSES):
            start_m = setpoint_m - direction * way_m
            rests_ma = belief.balance_ma(start_m)
            pressure = rollout.pressure.at_rest(rests_ma)
            task = self._task(belief, pressure, start_m, setpoint_m + direction * span_m, rests_ma)
            hold_ma = self.limits.clipped(belief.balance_ma(setpoint_m))
            way_m = shortest_m(rollout, replace(task, hold_ma=hold_ma), seen)
            if _FARTHER * way_m > _FARTHEST * span_m:
                return 0.0
        return _FARTHER * way_m

    def plan(self, memory: NmpcMemory, setpoint_m: float) -> tuple[SlipPlan, float] | None:
        """Return the braked move to a setpoint and σ of its stop in m, None where there is none that is sure.

        After a push in vain there is none: a quasi-static one says how strong a push the stem needs. Nor is one planned
        before a way has shown the lag: a push that was too short for it would be taken for one that friction has held.
        """
        pressure, belief, start_m = memory.pressure, memory.belief, self.judge.stem_m(memory)
        if pressure is None or memory.failed > 0 or start_m == setpoint_m:
            return None
        task = self._task(belief, pressure, start_m, setpoint_m, memory.sent_ma)
        if self.limits.excess_ma(belief.landing_ma(setpoint_m, task.direction) + _SPARE_MA * task.direction) > 0.0:
            return None  # only a current at its limit shows whether the stem comes so far
        span_m, theta = self.judge.valve.span_m, belief.numbers.mean
        found = slip_plan(self.plant, theta, belief.local_ma(setpoint_m, task.direction), task, _CLOSE * span_m)
        if found is None:
            return None
        variance_m2 = belief.numbers.variance(found.line)
        sigma_m = math.sqrt(variance_m2 + memory.position_m2 + self._planned_m2(memory, setpoint_m - start_m))
        if self._may_read(memory) and found.boosted >= found.stop.freed + self._seen_after(memory):
            read_m = math.sqrt(memory.braked.reading_m2)
            if read_m < sigma_m:
                return replace(found, by_reading=True), read_m
        return (found, sigma_m) if sigma_m <= _SURE * span_m and self.knows_lag(memory) else None

    def _task(
        self, belief: ValveBelief, pressure: PressureState, start_m: float, target_m: float, before_ma: float
    ) -> Task:
        """Return the task of a move."""
        actuator, period_s = self.judge.valve.actuator.with_lag(belief.lag_s), self.judge.period_s
        return task_of(belief, actuator, self.limits, pressure, start_m, target_m, period_s, before_ma, self.step_ma)

    def _may_read(self, memory: NmpcMemory) -> bool:
        """Whether readings have said well when to brake."""
        most_m = _SURE_BY_READING * self.judge.valve.span_m
        return self.knows_lag(memory) and memory.braked.reading_m2 <= most_m * most_m

    def _seen_after(self, memory: NmpcMemory) -> int:
        """Return after how many samples a stem that is freed is seen to move.

        With the acceleration a of the first instant it has moved 5 σ of the mean of n readings, 5 s/√n, once
        a (n T)²/2 is as much: n = (10 s/(a T²))^0.4. The sensor is late by its lag, and one sample more passes until
        the command acts.
        """
        belief, period_s = memory.belief, self.judge.period_s
        acceleration = (belief.static_ma - belief.sliding_ma) / self.judge.stem.mass
        samples: float = (_SEEN * self.judge.noise_m(memory) / (acceleration * period_s * period_s)) ** 0.4
        return 1 + math.ceil(samples + self.judge.valve.sensor_time_constant_s / period_s)

    def _planned_m2(self, memory: NmpcMemory, way_m: float) -> float:
        """Return the variance of a planned stop at the end of a way, beside what is not known of the valve."""
        least_m = _OWN * self.judge.valve.span_m
        return max(memory.braked.planned * way_m * way_m, least_m * least_m)

    def is_worth_it(self, memory: NmpcMemory, setpoint_m: float) -> bool:
        """Whether a braked move corrects an error that was just seen."""
        if memory.move.stage is None:
            return False
        error_m = abs(setpoint_m - self.judge.stem_m(memory))
        tolerable_m = _TOLERANCE * tolerance_m(self.judge.valve.span_m, memory.tries)
        if error_m <= max(tolerable_m, CERTAIN * math.sqrt(memory.position_m2)):
            return False
        found = self.plan(memory, setpoint_m)
        return found is not None and error_m > _WORTH * found[1]

    def with_way(self, memory: NmpcMemory, *, goes_on: bool) -> NmpcMemory:
        """Return the memory of a move that begins; goes_on: the stem may still be on its way."""
        pressure, way = memory.pressure, memory.braked.way
        if not goes_on:
            way = None if pressure is None else Way(pressure, memory.move.start_m)
        return replace(memory, braked=replace(memory.braked, way=way, track=None))

    def with_track(self, memory: NmpcMemory, plan: SlipPlan) -> NmpcMemory:
        """Return the memory of a braked move that begins."""
        task, belief = plan.task, memory.belief
        push_ma2 = belief.numbers.variance((task.target_m, 1.0, task.direction, 0.0)) + belief.scatter_ma2
        static_ma2 = belief.numbers.variance((task.start_m, 1.0, 0.0, task.direction)) + belief.scatter_ma2
        missed_m2, most_ma = self._planned_m2(memory, task.target_m - task.start_m), _FRICTION * belief.static_ma
        static_ma2 += missed_m2 / max(plan.line[3] * plan.line[3], missed_m2 / (most_ma * most_ma))
        moving = Moving(task.pressure, StemState(task.start_m, 0.0, True, task.direction))
        roams_ma2_per_m = memory.braked.roams * belief.roams_ma2_per_m
        track = Track(moving, Doubt(memory.position_m2, push_ma2), static_ma2, task.start_m, roams_ma2_per_m)
        memory = self.with_way(memory, goes_on=False)
        return replace(memory, braked=replace(memory.braked, track=track))

    # -- on the way

    def read(self, memory: NmpcMemory, measured_m: float) -> NmpcMemory:
        """Return the memory with the reading of a moving stem."""
        move, way, track = memory.move, memory.braked.way, memory.braked.track
        if move.stage in (None, Stage.RETURN):
            return memory
        if move.slip is not None and track is not None and not move.slip.is_over:
            variance_m2 = self.judge.reading_m2(memory, measured_m)
            reading = Reading(memory.sent_ma, measured_m, variance_m2, self.sensor)
            track = track.after(move.slip.rollout, reading)
        if way is not None:
            way = way.read(memory.sent_ma, measured_m)
        return replace(memory, braked=replace(memory.braked, way=way, track=track))

    def sent(self, memory: NmpcMemory, move: Move, plan: SlipPlan) -> tuple[Move, float]:
        """Return the move, and the current in mA of its next sample."""
        track, sent = memory.braked.track, move.sent
        if track is not None and not plan.is_over:
            since = round(move.since_s / self.judge.period_s)
            found: SlipPlan | None = None
            if since >= plan.ends or (plan.is_braking and track.may_rest):
                found = over(plan, track.moving)
            elif not track.has_not_slid:
                found = steered(plan, track, since, memory.sent_ma, self.planner)
            elif plan.by_reading:
                if since >= plan.latest:
                    found = steered(plan, track, since, memory.sent_ma, self.planner)
            elif since >= plan.boosted:
                found = replace(plan, currents=plan.currents[plan.boosted :], is_braking=True, is_over=True)
            if found is None:
                return move, plan.task.boost_ma
            plan, sent = found, 0
        if sent >= len(plan.currents):
            return replace(move, slip=plan), plan.task.hold_ma
        return replace(move, slip=plan, sent=sent + 1), plan.currents[sent]

    # -- after a move

    def studied(self, memory: NmpcMemory) -> NmpcMemory:
        """Return the memory with what the whole way of a move teaches, where the stem has gone most of it."""
        found = self._study(memory)
        if found is None:
            return replace(memory, braked=replace(memory.braked, way=None))
        return self._taught_by(*self._other_lag(*self._weighed(memory, found)))

    def _other_lag(self, memory: NmpcMemory, found: Studied) -> tuple[NmpcMemory, Studied]:
        """Return the memory of another lag than configured where it explains the way of a move by far better.

        That is asked until a way has shown the lag. Later on friction has been believed that makes up for a wrong lag.
        """
        if memory.is_lag_known or found.left_m2 < found.noise_m2:
            return memory, found
        other = replace(memory, belief=memory.belief.of_any_lag())
        others = self._study(other)
        if others is None or not _is_far_better(others, found):
            return memory, found
        return other, others

    def _weighed(self, memory: NmpcMemory, found: Studied) -> tuple[NmpcMemory, Studied]:
        """Return the memory with the likelier hypothesis, and what the way of a move teaches of it.

        The two are compared at the one fit that explains the way better: the other one may not have converged.
        """
        belief, other = memory.belief, memory.belief.other
        if other is None:
            return memory, found
        others = self._study(replace(memory, belief=other), found.fit)
        if others is None or not (found.is_explained or others.is_explained):
            return memory, found
        better = found if found.left_m2 < others.left_m2 else others
        believed = belief.weighed(other, better.log_factor(belief.numbers, other.numbers))
        chosen, left = (found, others) if believed.drift == belief.drift else (others, found)
        if chosen is others:  # it began around the other's numbers, and does not say where it had expected the end
            chosen = self._study(replace(memory, belief=other)) or others
        if believed.other is not None and left.is_explained:
            believed = replace(believed, other=replace(believed.other, numbers=left.numbers))
        return replace(memory, belief=believed), chosen

    def likelier(self, other: NmpcMemory, memory: NmpcMemory) -> NmpcMemory:
        """Return another memory where the way is not explained by this one, or by far better by the other.

        Else this one returns, with what the way teaches.
        """
        found = self._study(memory)
        if found is None:
            return other
        memory, found = self._weighed(memory, found)
        if not found.is_explained:
            return other
        others = self._study(other)
        is_better = others is not None and _is_far_better(others, found)
        return other if is_better else self._taught_by(memory, found)

    def _taught_by(self, memory: NmpcMemory, found: Studied) -> NmpcMemory:
        """Return the memory with what the way of a move has taught."""
        belief = memory.belief
        memory = replace(memory, braked=replace(memory.braked, way=None))
        memory = self._missed(memory, found)
        braked = memory.braked.missed(math.sqrt(found.left_m2), found.gone_m, by_reading=False)
        left_part = braked.left_part + _NEWEST * (found.left_part - braked.left_part)
        memory = replace(memory, braked=replace(braked, left_part=max(left_part, _LEAST_PART)))
        if not found.is_explained:
            return memory
        memory = replace(memory, belief=replace(belief, numbers=found.numbers))
        is_shown = found.numbers.variances[LAG] < _SHOWN * belief.numbers.variances[LAG]
        return replace(memory, is_lag_known=True, unpushed=None) if is_shown or not memory.is_blind else memory

    def _study(self, memory: NmpcMemory, near: Linear | None = None) -> Studied | None:
        """Return what the way of a move teaches, None where the stem has not gone most of it."""
        way, belief, move, judge = memory.braked.way, memory.belief, memory.move, self.judge
        if way is None or not way.is_whole:
            return None
        end_m = judge.stem_m(memory)
        least_m = judge.least_m(math.sqrt(memory.position_m2 + move.start_m2))
        way_m = move.direction * (move.target_m - move.start_m)
        if move.direction * (end_m - move.start_m) < max(least_m, _MOST_OF_WAY * way_m):
            return None
        reading_m2 = judge.reading_m2(memory, memory.position_m)
        local_ma, stops_m = belief.local_ma(move.target_m, move.direction), (self.limits.low_m, self.limits.high_m)
        study = Study(self.plant, way, local_ma, self.sensor, stops_m)
        return study.of(belief.numbers, belief.within, end_m, reading_m2, memory.braked.left_part, near)

    def _missed(self, memory: NmpcMemory, found: Studied) -> NmpcMemory:
        """Return the memory after a stop that was so far from where it was expected.

        The part of its variance that changes from move to move is scaled by what is seen of it (Mehra 1972).
        """
        belief, braked, line, square_m2 = memory.belief, memory.braked, found.line, found.missed_m * found.missed_m
        way_m = max(found.gone_m - memory.move.direction * found.missed_m, abs(found.missed_m))  # as it was expected
        own_m2 = self._planned_m2(memory, way_m)
        known_m2 = belief.numbers.variance(line) + memory.position_m2 + memory.move.start_m2
        total_m2, planned_m2 = known_m2 + own_m2, _after_miss(own_m2, square_m2, known_m2)
        part = min(braked.changes * belief.change_m2(line) / total_m2, 1.0)
        changes = _scaled(braked.changes, part, square_m2 / total_m2)
        planned, slip = planned_m2 / (way_m * way_m), memory.move.slip
        if slip is None or slip.by_reading:  # a stop that was not planned is no reason to trust planned ones
            planned = max(planned, braked.planned)
        return replace(memory, braked=replace(braked, planned=planned, changes=changes))

    def slipped(self, memory: NmpcMemory, plan: SlipPlan) -> NmpcMemory:
        """Return the memory with what the stop of a braked move teaches."""
        move, belief, position_m = memory.move, memory.belief, self.judge.stem_m(memory)
        moved_m, sigma_m = position_m - move.start_m, math.sqrt(memory.position_m2 + move.start_m2)
        way_m = move.target_m - move.start_m
        track = memory.braked.track
        if move.direction * moved_m <= self.judge.least_m(sigma_m):
            if self.limits.holds(position_m, move.direction):
                return memory
            braked = memory.braked.missed(way_m, way_m, by_reading=plan.by_reading)
            memory = replace(memory, failed=memory.failed + 1, braked=braked)
            has_not_slid = track is None or track.has_not_slid
            would_show = abs(way_m) > _VISIBLE * self.judge.least_m(sigma_m)
            if abs(moved_m) < self.judge.least_m(sigma_m) and has_not_slid and would_show:
                return memory.held(belief.held(position_m, move.direction, plan.stop.peak_ma))
            return memory
        memory = replace(memory, failed=0)
        if track is not None and track.read > _ENOUGH:
            roams = _scaled(memory.braked.roams, 1.0, track.misfit / track.read)
            memory = replace(memory, braked=replace(memory.braked, roams=roams))
        missed_m = position_m - move.target_m
        if plan.by_reading:
            return self._read_stop(memory, missed_m)
        known_m2 = belief.numbers.variance(plan.line) + sigma_m * sigma_m + self._planned_m2(memory, way_m)
        is_halved = abs(missed_m) < _HALVED * abs(way_m) + CERTAIN * sigma_m
        if not is_halved or missed_m * missed_m > _SURPRISE * known_m2:
            return replace(memory, braked=memory.braked.missed(missed_m, way_m, by_reading=False))
        return memory

    def _read_stop(self, memory: NmpcMemory, missed_m: float) -> NmpcMemory:
        """Return the memory after a stop that was braked by reading."""
        least_m, after_m2 = _OWN * self.judge.valve.span_m, _after_miss(memory.braked.reading_m2, missed_m * missed_m)
        return replace(memory, braked=replace(memory.braked, reading_m2=max(after_m2, least_m * least_m)))


def _is_far_better(others: Studied, found: Studied) -> bool:
    """Whether one belief explains a way, and by far better than another."""
    return others.is_explained and others.left_m2 < _LIKELIER * found.left_m2


def _after_miss(own_m2: float, square_m2: float, known_m2: float = 0.0) -> float:
    """Return the variance of braked stops after a squared miss; known_m2: what of it was expected beside."""
    if square_m2 > _SURPRISE * (known_m2 + own_m2):
        return square_m2
    return own_m2 + _NEWEST * (max(square_m2 - known_m2, 0.0) - own_m2)


def _scaled(times: float, part: float, square: float) -> float:
    """Return by how much a variance exceeds what is expected, after a square over its expectation.

    part: of that expectation which is due to this variance.
    """
    times *= 1.0 + _NEWEST * part * (min(square, _SURPRISE) - 1.0)
    return min(max(times, _LEAST_TIMES), _MOST_TIMES)
