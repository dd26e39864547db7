"""The law `quasi-static`: moves that end where spring and sliding friction balance the pressure. Pure.

In each cycle:

    estimate    the pressure follows the commands by the model; once it has arrived and the stem has had the time to
                follow, the readings are a rest, and their mean is the position
    decide      at rest: is another move worth while? At the end of a move: what does it teach, and what comes next?

A move commands one level, at which the model of the valve stops the stem at its target, and holds it until the stem
rests there: neither the lag of the actuator nor the speed of the stem enters, so a wrong lag costs time and no place.
Then the current goes to the middle of the stick band, where no force of either sign frees the stem easily. What is
learned of the valve is learned at rest (`belief`). A lag that was seen to be no shorter than configured is hurried
through: the current stays at its limit until seven tenths of the way are done.

A correction is made where it is worth while (`move.is_worth_it`). After seven moves to one setpoint the stem is left.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.bounds import Bounds
from positioner.laws.estimator_settings import measurement_sigma_m
from positioner.laws.law import Decision, Estimate
from positioner.laws.quasi_static.belief import Landing, belief_of
from positioner.laws.quasi_static.kept import lesson_of, taught
from positioner.laws.quasi_static.lag import MORE_PATIENCE_S, PATIENCE_S, more_lag_s, way_of
from positioner.laws.quasi_static.landing import landing_of
from positioner.laws.quasi_static.memory import Move, QuasiStaticMemory
from positioner.laws.quasi_static.move import (
    LARGE,
    LEFT_OF_STEP,
    Currents,
    Limits,
    Stage,
    Stem,
    Step,
    boost_samples,
    can_follow,
    is_worth_it,
    margin_m,
    steps_to,
    tolerance_m,
)
from positioner.laws.quasi_static.rest import NO_REST, Noise
from positioner.values import dataclass, replace
from positioner.valve.actuator import left_of_lag
from positioner.valve.pressure import PressureModel, pressure_model
from positioner.valve.state import StemState
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from positioner.laws.estimator_settings import EstimatorSettings
    from positioner.laws.law import Observation
    from positioner.laws.move_reason import MoveReason
    from positioner.valve.parameters import ValveParameters
    from positioner.valve.stiction import StictionTable

_NEW_TOLERANCE = 0.0007
"""Of the span: a new setpoint that is nearer than this needs no move."""
_CERTAIN = 2.2
"""σ of the mean of the readings that an error must exceed."""
_HASTY, _LONG_S = 5.0, 0.15
"""σ of the mean that an error must exceed before the readings of 0.15 s have been averaged."""
_MOST_MOVES = 6
"""Corrections at one setpoint. With 14 the robustness test loses as many dwells, 384 instead of 386, and a stem whose
reading stands still is thrown about for twice as long."""
_FOLLOWED, _FOLLOWED_S = 4.0, 0.03
"""The stem follows within four of its time constants, e⁻⁴ = 2 %, and 30 ms."""
_ARRIVED_MA = 0.01
"""So near to its level the pressure has arrived: 0.05 % of span on the paper's valve."""
_OF_STEP, _OF_ERROR, _OF_MARGIN = 0.05, 0.1, 0.3
"""Earlier where less matters: 5 % of the step, a tenth of the error that is seen, a third of a margin."""
_LATER, _FIRST_LATER, _MOST_LATER_S = 1.4, 0.25, 1.0
"""A stem that moves in its rest needs longer: 1.4 times what was added, at least a quarter of the move, at most 1 s."""
_SURE = 0.008
"""Of span: σ of a landing up to which a move away is not measured: it ends as soon as it is seen to be far enough."""
_AWAY_S, _LAND_S, _ENOUGH_S = 0.02, 0.04, 0.25
_AWAY_BLOCKS, _LAND_BLOCKS = 2, 3
"""Least length of a rest before it is judged, in s and in blocks of readings, and the length that is always enough."""
_OF_TOLERANCE, _OF_SEEN = 0.25, 0.15
"""A landing is judged once σ of the mean is a quarter of the tolerance, or 15 % of the error; after 0.25 s at last."""
_SLID = 0.9
"""Of F_c: a push beyond it may have moved the stem, so that its place is a landing."""
_MOVED, _MOVED_M = 3.0, 1e-4
"""σ of a difference of two means, and its least, that say that the stem has moved."""
_PUSHED, _CHANCE = 0.6, 2
"""Of F_s: a weaker push that moved nothing teaches nothing. More pushes in a row that have not moved the stem their way
are no chance: the valve differs, as where the actuator is reversed."""
_LAG_SAMPLES, _SHORTER = 4.0, 0.8
"""A lag of fewer samples is not hurried, nor one of which less than 80 % is seen."""
_SMOOTHING, _OF_READING = 0.35, 0.5
"""Weight of the newest reading in the smoothed one, and σ of it over that of a reading: √(0.35/1.65) = 0.46."""
_TRACKING = 0.3
"""Weight of the newest reading in the position of a moving stem."""
_SEEN, _OF_MOVE = 3.0, 0.25
"""σ of a lag, and the part of the move's length that it must be below for the move to show the lag."""
_STEP_S = 1e-3
"""Of the integration of a stem, whose time constants are some ms."""


@dataclass(frozen=True, slots=True)
class QuasiStaticLaw:
    """The law of one valve; the constants of a cycle. keeps: the stiction table learns where moves end (`kept`)."""

    name: str
    valve: ValveParameters
    estimator: EstimatorSettings
    limits: Limits
    period_s: float
    model: PressureModel
    stem: Stem
    keeps: bool = True

    def begin(self, measured_m: float) -> QuasiStaticMemory:
        """Return the memory of a law that starts at this reading, in m, and knows what is configured."""
        doubt_m = 0.1 * self.valve.span_m
        move = Move(None, 0.0, measured_m, 0.0, 0.0, 0.0, measured_m, doubt_m * doubt_m, 0.0)
        belief = belief_of(self.valve)
        return QuasiStaticMemory(belief, Noise(), move, NO_REST, None, measured_m, doubt_m * doubt_m, measured_m)

    def resumed(self, memory: QuasiStaticMemory, measured_m: float) -> QuasiStaticMemory:
        """Return the memory of a law that starts again at a place in m, and knows what it has learned of the valve."""
        return self.begin(measured_m).knowing(memory)

    # -- what a reading says

    def estimate(self, memory: QuasiStaticMemory, observation: Observation) -> tuple[QuasiStaticMemory, Estimate]:
        """Return the memory with this cycle's reading in it, and the stem."""
        pressure, move, sent_ma, behind_ma = memory.pressure, memory.move, memory.sent_ma, memory.behind_ma
        if pressure is None:
            sent_ma = behind_ma = observation.applied_ma
            pressure = self.model.at_rest(sent_ma)
            move = replace(move, level_ma=sent_ma, before_ma=sent_ma, from_ma=sent_ma)
        for _ in range(max(1, round(observation.elapsed_s / self.period_s))):
            pressure = self.model.after(pressure, sent_ma)
        measured_m, elapsed_s, more_s = observation.measured_m, observation.elapsed_s, memory.more_lag_s
        if more_s == 0.0:
            behind_ma = pressure.pressure_ma
        else:
            from_ma = pressure.converter_ma
            behind_ma = from_ma + (behind_ma - from_ma) * left_of_lag(
                elapsed_s, self.valve.actuator.own_lag_s(fills=from_ma > behind_ma) + more_s
            )
        smooth_m = memory.smooth_m + _SMOOTHING * (measured_m - memory.smooth_m)
        area_m_s = move.area_m_s + (measured_m - move.start_m) * elapsed_s
        move = replace(move, since_s=move.since_s + elapsed_s, area_m_s=area_m_s)
        memory = replace(memory, pressure=pressure, smooth_m=smooth_m, move=move, sent_ma=sent_ma, behind_ma=behind_ma)
        arrived, lessons = abs(behind_ma - move.level_ma) <= self._near_ma(memory), memory.lessons
        memory = replace(memory, settled_s=memory.settled_s + elapsed_s if arrived else 0.0, lessons=())
        if memory.settled_s >= self._follows_s(memory):
            memory = self._rested(memory, measured_m, elapsed_s)
        if memory.rest.readings:
            mean_m = memory.rest.mean_m
            variance_m2, worth = memory.noise.of(self.sigma_m(mean_m))
            memory = replace(memory, position_m=mean_m, position_m2=variance_m2 * worth / memory.rest.readings)
        else:
            position_m = memory.position_m + _TRACKING * (measured_m - memory.position_m)
            memory = replace(memory, position_m=position_m)
        direction = -1.0 if memory.move.direction < 0.0 else 1.0
        stuck = memory.move.stage is None
        return memory, Estimate(StemState(memory.position_m, 0.0, stuck, direction), lessons)

    def _rested(self, memory: QuasiStaticMemory, measured_m: float, elapsed_s: float) -> QuasiStaticMemory:
        """Return the memory after a reading of a stem that should rest."""
        variance_m2, worth = memory.noise.of(self.sigma_m(measured_m))
        rest, full = memory.rest.read(measured_m, elapsed_s, self.period_s)
        if not full or rest.moved_m(self.period_s, variance_m2, worth) == 0.0:
            return replace(memory, rest=rest)
        later_s = memory.later_s
        if memory.move.stage is None:
            if memory.carried is None:
                memory = replace(memory, carried=(memory.position_m, memory.position_m2))
        else:
            later_s = min(max(_LATER * later_s, _FIRST_LATER * memory.move.since_s), _MOST_LATER_S)
        return replace(memory, rest=NO_REST, later_s=later_s)

    def _near_ma(self, memory: QuasiStaticMemory) -> float:
        """Return how near to its level the pressure must be: where the stem can be judged."""
        move, spring = memory.move, memory.belief.spring_ma_per_m
        if move.stage is Stage.AWAY:
            return _OF_MARGIN * spring * move.margin_m
        if move.stage is Stage.LAND:
            if memory.rest.readings and memory.setpoint_m is not None:
                return max(_ARRIVED_MA, _OF_ERROR * spring * abs(memory.setpoint_m - memory.position_m))
            return _ARRIVED_MA + _OF_STEP * abs(move.level_ma - move.before_ma)
        return _ARRIVED_MA

    def _follows_s(self, memory: QuasiStaticMemory) -> float:
        """Return how long after the pressure has arrived the stem and its sensor have followed."""
        stem = self.stem
        follows_s = stem.viscous / memory.belief.spring_ma_per_m + stem.mass / stem.viscous
        return _FOLLOWED * (follows_s + self.valve.sensor_time_constant_s) + _FOLLOWED_S + memory.later_s

    def sigma_m(self, position_m: float) -> float:
        """Return the configured σ of a reading in m at a place."""
        return measurement_sigma_m(self.estimator, self.valve, position_m)

    def _stem_m(self, memory: QuasiStaticMemory) -> float:
        """Return the place of the stem: backlash is taken up in the direction of the last move."""
        return memory.position_m + 0.5 * memory.move.direction * self.valve.backlash_m

    # -- what to do

    def decide(
        self, memory: QuasiStaticMemory, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[QuasiStaticMemory, Decision]:
        """Return the memory after the decision, and the decision; the stiction table is read once."""
        del stem
        setpoint_m = observation.setpoint_m
        if self.keeps and not memory.has_read:
            belief = taught(memory.belief, table, self.sigma_m(memory.position_m))
            memory = replace(memory, belief=belief, has_read=True)
        if setpoint_m != memory.setpoint_m:
            memory = replace(memory, setpoint_m=setpoint_m, is_new=True, tries=0, pending=())
        setpoint_m = memory.belief.reachable_m(setpoint_m, self.limits.low_ma, self.limits.high_ma)
        reason: MoveReason | None = None
        move, failed = memory.move, memory.failed
        if move.stage is None or (move.stage is Stage.RETURN and memory.is_new):
            memory, reason = self._considered(memory, setpoint_m)
        elif memory.pending and self._is_away(memory):
            sigma_m = _OF_READING * self._noise_m(memory)
            memory = replace(memory, position_m=memory.smooth_m, position_m2=sigma_m * sigma_m)
            memory, reason = self._next(memory, setpoint_m)
            memory = replace(memory, move=replace(memory.move, is_hurried=True))
        elif memory.rest.readings and self._is_judged(memory, setpoint_m):
            memory = self._followed(self._settled(memory))
            if memory.settled_s:
                memory, reason = self._next(self._learned(memory), setpoint_m)
        move = memory.move
        current_ma, rests = self.limits.clipped(move.level_ma), move.stage is None
        if move.boosted > 0 and self._is_near(memory):
            move = replace(move, boosted=0)
        if move.boosted > 0:
            current_ma, move = move.boost_ma, replace(move, boosted=move.boosted - 1)
        bounds = Bounds(-math.inf, math.inf, self.limits.low_ma, self.limits.high_ma)
        motion = Motion.REST if rests else Motion.MOVE
        memory = replace(memory, move=move, sent_ma=current_ma)
        failed = memory.failed if memory.failed > failed else 0
        differs = memory.failed > _CHANCE
        return memory, Decision(current_ma, bounds, motion, reason=reason, failed_pushes=failed, differs=differs)

    def _next(self, memory: QuasiStaticMemory, setpoint_m: float) -> tuple[QuasiStaticMemory, MoveReason | None]:
        """Return the memory after a move that has been judged, and why another one begins."""
        if memory.pending:
            step, *later = memory.pending
            goes_no_farther = memory.move.level_ma in (self.limits.low_ma, self.limits.high_ma)
            is_far = can_follow(memory.belief, self._stem_m(memory), step, self._through(memory))
            if not (goes_no_farther or is_far) and memory.tries <= _MOST_MOVES:
                return self._planned(memory, setpoint_m)
            return self._begun(replace(memory, pending=tuple(later)), step)
        if memory.move.stage is Stage.LAND:
            if memory.failed == 0:
                memory = replace(memory, lasts_s=memory.move.since_s)
            if self._is_worth_it(memory, setpoint_m) and memory.tries <= _MOST_MOVES:
                return self._planned(memory, setpoint_m)
            memory, noise = replace(memory, is_new=False), memory.noise.after(memory.rest)
            middle_ma = memory.move.level_ma - memory.move.direction * memory.belief.sliding_ma
            move = self._commanded(memory, Stage.RETURN, memory.move.direction, memory.move.target_m, middle_ma)
            return replace(memory, noise=noise, move=move, rest=NO_REST, settled_s=0.0), None
        return self._considered(replace(memory, move=replace(memory.move, stage=None)), setpoint_m)

    def _considered(self, memory: QuasiStaticMemory, setpoint_m: float) -> tuple[QuasiStaticMemory, MoveReason | None]:
        """Return the memory of a resting stem, and why a move begins, if one does."""
        if memory.carried is not None:
            is_brief = memory.rest.duration_s < _LAND_S or memory.rest.blocks < _LAND_BLOCKS
            if is_brief and not memory.is_new:
                return memory, None
            memory = replace(memory, carried=None) if is_brief else self._carried(memory, *memory.carried)
        error_m = abs(setpoint_m - self._stem_m(memory))
        if memory.is_new:
            if error_m < _NEW_TOLERANCE * self.valve.span_m:
                return replace(memory, is_new=False), None
        else:
            if memory.rest.readings < 2 or not self._is_worth_it(memory, setpoint_m):  # noqa: PLR2004 - a mean
                return memory, None
            if error_m < _HASTY * math.sqrt(memory.position_m2) and memory.rest.duration_s < _LONG_S:
                return memory, None
        if memory.tries > _MOST_MOVES:
            return memory, None
        return self._planned(memory, setpoint_m)

    def _is_worth_it(self, memory: QuasiStaticMemory, setpoint_m: float) -> bool:
        """Whether an error is seen, and a correction of it is worth while."""
        stem_m, span_m, tries = self._stem_m(memory), self.valve.span_m, memory.tries
        if abs(setpoint_m - stem_m) <= max(tolerance_m(span_m, tries), _CERTAIN * math.sqrt(memory.position_m2)):
            return False
        steps = self._steps_to(memory, setpoint_m)
        return is_worth_it(memory.belief, steps, stem_m, setpoint_m, span_m, memory.lasts_s, tries)

    def _steps_to(self, memory: QuasiStaticMemory, setpoint_m: float) -> tuple[Step, ...]:
        """Return the moves that lead to a setpoint."""
        return steps_to(memory.belief, self.limits, self._stem_m(memory), setpoint_m, self._through(memory))

    def _through(self, memory: QuasiStaticMemory) -> float:
        """Return the slip jumps from which on a stem slides through, behind the slower one of the lags."""
        lag_s = self.valve.actuator.slower_lag_s + memory.more_lag_s
        return self.stem.slides_through(memory.belief.spring_ma_per_m, lag_s)

    def _is_judged(self, memory: QuasiStaticMemory, setpoint_m: float) -> bool:
        """Whether the readings since the end of a move are enough to go on."""
        rest, stage = memory.rest, memory.move.stage
        if stage is not Stage.LAND:
            return stage is Stage.RETURN or (rest.duration_s >= _AWAY_S and rest.blocks >= _AWAY_BLOCKS)
        if rest.duration_s < _LAND_S or rest.blocks < _LAND_BLOCKS:
            return False
        error_m, sigma_m = abs(setpoint_m - self._stem_m(memory)), math.sqrt(memory.position_m2)
        least_m = max(_OF_TOLERANCE * tolerance_m(self.valve.span_m, memory.tries), _OF_SEEN * error_m)
        return sigma_m < least_m or rest.duration_s > _ENOUGH_S

    def _is_away(self, memory: QuasiStaticMemory) -> bool:
        """Whether a stem that moves away is far enough for the next move, and its end is not to be measured."""
        move = memory.move
        if move.stage is not Stage.AWAY or not self._is_sure(memory):
            return False
        return self._is_seen_within(memory, move.margin_m)

    def _is_sure(self, memory: QuasiStaticMemory) -> bool:
        """Whether the move that is to be made next ends where it should, as far as is known."""
        step = memory.pending[0]
        return memory.belief.landing_sigma_m(step.target_m, step.direction) < _SURE * self.valve.span_m

    def _is_near(self, memory: QuasiStaticMemory) -> bool:
        """Whether the reading shows that a hurried pressure is as far as it should be hurried."""
        move = memory.move
        step_ma = abs(move.level_ma - move.from_ma)
        return self._is_seen_within(memory, LEFT_OF_STEP[move.stage] * step_ma / memory.belief.spring_ma_per_m)

    def _is_seen_within(self, memory: QuasiStaticMemory, left_m: float) -> bool:
        """Whether the reading shows that the stem has at most this way left to the target of its move."""
        move = memory.move
        missing_m = move.direction * (move.target_m - memory.smooth_m)
        return missing_m < left_m - _CERTAIN * _OF_READING * self._noise_m(memory)

    def _least_m(self, sigma_m: float) -> float:
        """Return the difference of two means, whose σ is given, that says that the stem has moved."""
        return max(_MOVED * sigma_m, _MOVED_M) + self.valve.backlash_m

    def _is_beyond(self, memory: QuasiStaticMemory) -> bool:
        """Whether a hurried move has gone too far: the lag is shorter than believed."""
        move, beyond_m = memory.move, memory.move.direction * (self._stem_m(memory) - memory.move.target_m)
        landing_m = _MOVED * memory.belief.landing_sigma_m(move.target_m, move.direction)
        return move.is_hurried and beyond_m > max(LARGE * self.valve.span_m, landing_m)

    def _noise_m(self, memory: QuasiStaticMemory) -> float:
        """Return σ of a reading, as the rests have shown it."""
        variance_m2, _ = memory.noise.of(self.sigma_m(memory.smooth_m))
        return math.sqrt(variance_m2)

    def _settled(self, memory: QuasiStaticMemory) -> QuasiStaticMemory:
        """Return the memory with the place of the last readings, where those before were of a stem that crept."""
        variance_m2, worth = memory.noise.of(self.sigma_m(memory.position_m))
        position_m, readings = memory.rest.latest(self.period_s, variance_m2, worth)
        return replace(memory, position_m=position_m, position_m2=variance_m2 * worth / readings)

    def _followed(self, memory: QuasiStaticMemory) -> QuasiStaticMemory:
        """Return the memory with what a move shows of the lag; not settled where the pressure is still on its way."""
        move, belief = memory.move, memory.belief
        if move.stage is Stage.RETURN or move.is_hurried:
            return replace(memory, hurries=False) if self._is_beyond(memory) else memory
        direction = 1.0 if move.level_ma > move.from_ma else -1.0
        step_ma, spring = direction * (move.level_ma - move.from_ma), belief.spring_ma_per_m
        moved_m = direction * (self._stem_m(memory) - move.start_m)
        variance_m2, worth = memory.noise.of(self.sigma_m(memory.position_m))
        sigma_m = math.sqrt(memory.position_m2 + move.start_m2)
        if moved_m < self._least_m(sigma_m):
            freed = direction * (move.level_ma - belief.balance_ma(move.start_m)) > belief.static_ma
            patience_s = PATIENCE_S if memory.unpushed is None else MORE_PATIENCE_S
            waits = freed and not memory.is_lag_known and move.since_s < patience_s
            return replace(memory, rest=NO_REST, settled_s=0.0) if waits else memory
        free_ma = direction * (belief.balance_ma(move.start_m) - move.from_ma) + belief.static_ma
        way = way_of(step_ma, free_ma, spring, moved_m, move.since_s)
        area_m_s = moved_m * move.since_s - direction * move.area_m_s
        noise_m2 = move.since_s * self.period_s * variance_m2 * worth
        sigma_s = way.sigma_s(math.sqrt(noise_m2 + move.since_s * move.since_s * sigma_m * sigma_m))
        is_blind = memory.unpushed is not None and step_ma < 2.0 * belief.sliding_ma  # on the way of the move before it
        if is_blind or _SEEN * sigma_s > _OF_MOVE * move.since_s:
            return memory
        told_s, seen_s, before_s = self.valve.lag_s, way.lag_s(area_m_s), memory.more_lag_s
        memory = replace(memory, is_lag_known=True, hurries=seen_s > _SHORTER * (told_s + before_s))
        more_s = more_lag_s(told_s, seen_s, before_s, self.period_s + _SEEN * sigma_s)
        if more_s == before_s == 0.0:
            return replace(memory, unpushed=None)
        behind_ma = move.level_ma - direction * way.after_ma(told_s + more_s)
        memory = memory.behind(more_s, behind_ma)
        if abs(behind_ma - move.level_ma) <= self._near_ma(memory):
            return memory
        return replace(memory, rest=NO_REST, settled_s=0.0)

    def _learned(self, memory: QuasiStaticMemory) -> QuasiStaticMemory:
        """Return the memory with what the end of a move teaches: a landing, or a push that moved nothing."""
        move, belief, position_m = memory.move, memory.belief, self._stem_m(memory)
        direction = 1.0 if move.level_ma > move.before_ma else -1.0
        if memory.pressure is None or self.limits.holds(position_m, direction):
            return memory
        moved_m, sigma_m = position_m - move.start_m, math.sqrt(memory.position_m2 + move.start_m2)
        push_ma = direction * (move.level_ma - belief.balance_ma(move.start_m))
        if direction * moved_m > self._least_m(sigma_m):
            if not move.is_hurried:
                belief = belief.freed(move.start_m, direction, move.level_ma)
            memory = replace(memory, failed=0, belief=belief)
            if push_ma <= _SLID * belief.sliding_ma:
                return memory
            landing, doubt_ma2 = landing_of(move, position_m, direction, memory.behind_ma, belief.spring_ma_per_m)
            belief = belief.landed(landing, memory.position_m2, doubt_ma2)
            if self.keeps and move.stage is Stage.LAND:
                memory = replace(memory, lessons=(lesson_of(belief, landing),))
        elif direction * (move.level_ma - belief.balance_ma(position_m)) > _PUSHED * belief.static_ma:
            memory = replace(memory, failed=memory.failed + 1)
            if abs(moved_m) < _MOVED * sigma_m + _MOVED_M + self.valve.backlash_m:
                return memory.held(belief.held(position_m, direction, move.level_ma))
        return replace(memory, belief=belief)

    def _carried(self, memory: QuasiStaticMemory, from_m: float, from_m2: float) -> QuasiStaticMemory:
        """Return the memory after a force has moved a stem under a current that stood still: this is a landing, too."""
        moved_m, sigma_m = memory.position_m - from_m, math.sqrt(memory.position_m2 + from_m2)
        memory, direction = replace(memory, carried=None), 1.0 if moved_m > 0.0 else -1.0
        position_m = memory.position_m + 0.5 * direction * self.valve.backlash_m
        if abs(moved_m) < self._least_m(sigma_m) or self.limits.holds(position_m, direction):
            return memory
        landing = Landing(position_m, direction, memory.behind_ma)
        belief = memory.belief.landed(landing, memory.position_m2, 0.0, is_force=True)
        return replace(memory, belief=belief, move=replace(memory.move, direction=direction))

    def _planned(self, memory: QuasiStaticMemory, setpoint_m: float) -> tuple[QuasiStaticMemory, MoveReason | None]:
        """Return the memory in which the first move to the setpoint has begun, and why."""
        memory = replace(
            memory,
            is_new=False,
            tries=memory.tries + 1,
            noise=memory.noise.after(memory.rest),
            belief=memory.belief.after_move(),
        )
        step, *later = self._steps_to(memory, setpoint_m)
        return self._begun(replace(memory, pending=tuple(later)), step)

    def _begun(self, memory: QuasiStaticMemory, step: Step) -> tuple[QuasiStaticMemory, MoveReason | None]:
        """Return the memory in which a move has begun, and why it begins."""
        belief, pressure = memory.belief, memory.pressure
        start_m, direction = self._stem_m(memory), step.direction
        level_m = step.target_m
        if step.stage is Stage.AWAY and memory.pending and self._is_sure(memory):
            level_m += direction * 2.0 * _CERTAIN * _OF_READING * self._noise_m(memory)
        move = self._commanded(memory, step.stage, direction, step.target_m, belief.landing_ma(level_m, direction))
        if pressure is not None:
            move = self._hurried(memory, move)
            swings = self.stem.swings(belief.spring_ma_per_m, self.valve.actuator.lag_s(fills=direction > 0.0))
            if step.stage is Stage.LAND and memory.more_lag_s == 0.0 and swings:
                currents = Currents(direction, move.level_ma, move.boost_ma, move.boosted)
                beyond_m = direction * self.stem.beyond_m(self.model, pressure, belief, start_m, currents)
                level_ma = self.limits.clipped(move.level_ma - belief.spring_ma_per_m * beyond_m)
                move = replace(move, inertia_m=beyond_m, level_ma=level_ma)
        reason = belief.reason(start_m, step.target_m, direction, self.valve.force_gain_n_per_ma)
        return replace(memory, move=move, rest=NO_REST, settled_s=0.0), reason

    def _commanded(
        self, memory: QuasiStaticMemory, stage: Stage, direction: float, target_m: float, level_ma: float
    ) -> Move:
        """Return a move to a level, from where the stem is now."""
        before_ma = memory.move.level_ma
        from_ma = before_ma if memory.pressure is None else memory.behind_ma
        start_m, near_m = self._stem_m(memory), margin_m(memory.belief)
        level_ma = self.limits.clipped(level_ma)
        return Move(stage, direction, target_m, level_ma, before_ma, from_ma, start_m, memory.position_m2, near_m)

    def _hurried(self, memory: QuasiStaticMemory, move: Move) -> Move:
        """Return the move with the samples in which the current stays at its limit, where the lag is known."""
        fills = move.level_ma > move.from_ma
        lag_s = self.valve.actuator.lag_s(fills=fills) + memory.more_lag_s if memory.hurries else 0.0
        if lag_s <= _LAG_SAMPLES * self.period_s:
            return move
        boost_ma = self.limits.high_ma if fills else self.limits.low_ma
        whole_ma, step_ma = boost_ma - move.from_ma, move.level_ma - move.from_ma
        samples = boost_samples(lag_s, self.period_s, whole_ma, step_ma, LEFT_OF_STEP[move.stage])
        return replace(move, boost_ma=boost_ma, boosted=samples, is_hurried=samples > 0)


def quasi_static_law(
    valve: ValveParameters,
    estimator: EstimatorSettings,
    currents_ma: tuple[float, float],
    period_s: float,
    delay_s: float,
) -> QuasiStaticLaw:
    """Return the law of a valve.

    Args:
        valve: as configured.
        estimator: the configured noise of its sensor.
        currents_ma: the lowest and the highest current.
        period_s: of the readings.
        delay_s: from a reading until its command acts.
    """
    gain, (low_ma, high_ma) = valve.force_gain_n_per_ma, currents_ma
    steps = max(1, math.ceil(period_s / _STEP_S - 1e-9))
    limits = Limits(low_ma, high_ma, valve.travel_min_m, valve.travel_max_m)
    stem = Stem(valve.mass_kg / gain, valve.viscous_friction_n_s_per_m / gain, period_s / steps, steps)
    model = pressure_model(valve, period_s, delay_s)
    return QuasiStaticLaw("quasi-static", valve, estimator, limits, period_s, model, stem)
