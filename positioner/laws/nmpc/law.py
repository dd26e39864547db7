"""The laws `quasi-static` and `nmpc`: moves that end where spring and sliding friction balance the pressure. Pure.

    estimate    the pressure follows the commands by the model; once it has arrived and the stem has had the time to
                follow, the readings are a rest, and their mean is the position
    decide      at rest: is another move worth while? At the end of a move: what does it teach, and what comes next?

A move commands one level, at which the model of the valve stops the stem at its target, and holds it until the stem
rests there: neither the lag of the actuator nor the speed of the stem enters, so a wrong lag costs time and no place.
Then the current goes to the middle of the stick band, where no force of either sign frees the stem easily. What is
learned of the valve is learned at rest (`belief`). A lag that was seen to be no shorter than configured is hurried
through: the current stays at its limit until seven tenths of the way are done. With braked moves the first ones are
hurried, too, once the stem was seen to stand still under the level: a pressure that is there at once is not.

A correction is made where it is worth while (`move.is_worth_it`). After seven moves to one setpoint the stem is left,
and tried again each second or two, and at last every 60 s. The law `nmpc` brakes moves where it can (`braking`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.bounds import Bounds
from positioner.laws.correction import LEFT
from positioner.laws.law import Decision, Estimate
from positioner.laws.nmpc.belief import Landing, belief_of, lag_s_of
from positioner.laws.nmpc.judging import CERTAIN, LAND_BLOCKS, LAND_S, OF_READING, Judge
from positioner.laws.nmpc.kept import lesson_of, taught
from positioner.laws.nmpc.lag import MORE_PATIENCE_S, PATIENCE_S, more_lag_s, way_of
from positioner.laws.nmpc.landing import MoveEnds, inertia_m
from positioner.laws.nmpc.memory import Move, NmpcMemory
from positioner.laws.nmpc.move import (
    LARGE,
    LEFT_OF_STEP,
    Limits,
    Stage,
    Step,
    boost_samples,
    can_follow,
    is_worth_it,
    margin_m,
    steps_to,
    tolerance_m,
    waits_s,
)
from positioner.laws.nmpc.rest import NO_REST, Noise
from positioner.values import dataclass, replace
from positioner.valve.state import StemState
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from positioner.laws.law import Observation
    from positioner.laws.move_reason import MoveReason
    from positioner.laws.nmpc.braking import Braking
    from positioner.valve.actuator import ActuatorParameters
    from positioner.valve.parameters import ValveParameters
    from positioner.valve.rollout import Plant
    from positioner.valve.stiction import StictionTable

_NEW_TOLERANCE = 0.0007
"""Of the span: a new setpoint that is nearer than this needs no move."""
_EXPECTED = 0.8
"""Of σ: the mean |error| of a normal distribution, √(2/π)."""
_HASTY, _LONG_S = 5.0, 0.15
"""σ of the mean that an error must exceed before the readings of 0.15 s have been averaged."""
_MOST_MOVES = 6
"""Corrections at one setpoint. With 14 the robustness test loses as many dwells, 384 instead of 386, and a stem whose
reading stands still is thrown about for twice as long."""
_CHANCE = 2
"""More pushes in a row that have not moved the stem their way are no chance: the valve differs, as where the actuator
is reversed."""
_LAG_SAMPLES, _SHORTER = 4.0, 0.8
"""A lag of fewer samples is not hurried, nor one of which less than 80 % is seen."""
_AT_LIMIT_MA = 0.2
"""So near to its limit a level pushes the stem as far as any."""
_SMOOTHING = 0.35
"""Weight of the newest reading in the smoothed one."""
_TRACKING = 0.3
"""Weight of the newest reading in the position of a moving stem."""
_SEEN, _OF_MOVE = 3.0, 0.25
"""σ of a lag, and the part of the move's length that it must be below for the move to show the lag."""


@dataclass(frozen=True, slots=True)
class NmpcLaw:
    """The law of one valve; the constants of a cycle.

    keeps: the stiction table learns where moves end (`kept`), and is read at `table_from_s`, in s since control began.
    braking: of braked moves, None where none are made.
    """

    name: str
    judge: Judge
    limits: Limits
    plant: Plant
    keeps: bool = True
    braking: Braking | None = None
    table_from_s: float = 0.0
    rate_ma_per_s: float = math.inf

    @property
    def valve(self) -> ValveParameters:
        """The valve as configured."""
        return self.judge.valve

    @property
    def ends(self) -> MoveEnds:
        """What the ends of moves teach."""
        return MoveEnds(self.judge, self.limits, self.keeps)

    def begin(self, measured_m: float) -> NmpcMemory:
        """Return the memory of a law whose first setpoint is this reading, in m, and that knows what is configured."""
        doubt_m, sigma_m = 0.1 * self.valve.span_m, self.judge.sigma_m(measured_m)
        move = Move(None, 0.0, measured_m, 0.0, 0.0, 0.0, measured_m, doubt_m * doubt_m, 0.0)
        belief = belief_of(self.valve)
        memory = NmpcMemory(
            belief,
            Noise(),
            move,
            NO_REST,
            None,
            measured_m,
            doubt_m * doubt_m,
            measured_m,
            setpoint_m=measured_m,
            setpoint_m2=sigma_m * sigma_m,
        )
        return memory if self.braking is None else replace(memory, hurries=True, braked=self.braking.begun())

    def resumed(self, memory: NmpcMemory, measured_m: float) -> NmpcMemory:
        """Return the memory of a law that starts again at a place in m, and knows what it has learned of the valve."""
        return self.begin(measured_m).knowing(memory)

    # -- what a reading says

    def estimate(self, memory: NmpcMemory, observation: Observation) -> tuple[NmpcMemory, Estimate]:
        """Return the memory with this cycle's reading in it, and the stem."""
        pressure, move, sent_ma = memory.pressure, memory.move, memory.sent_ma
        if pressure is None:
            sent_ma = observation.applied_ma
            pressure = self.plant.actuator.at_rest(sent_ma)
            move = replace(move, level_ma=sent_ma, before_ma=sent_ma, from_ma=sent_ma)
        belief = memory.belief
        model = self.plant.actuator.with_lag(belief.lag_s).with_dead_time(belief.dead_time_s)
        for _ in range(self.plant.steps * max(1, round(observation.elapsed_s / self.judge.period_s))):
            pressure = model.after(pressure, sent_ma)
        measured_m, elapsed_s = observation.measured_m, observation.elapsed_s
        smooth_m = memory.smooth_m + _SMOOTHING * (measured_m - memory.smooth_m)
        area_m_s = move.area_m_s + (measured_m - move.start_m) * elapsed_s
        move = replace(move, since_s=move.since_s + elapsed_s, area_m_s=area_m_s)
        memory = replace(
            memory,
            pressure=pressure,
            smooth_m=smooth_m,
            move=move,
            sent_ma=sent_ma,
            way_s=memory.way_s + elapsed_s,
        )
        if self.braking is not None:
            memory = self.braking.read(memory, measured_m)
        arrived, lessons = abs(pressure.pressure_ma - move.level_ma) <= self.judge.near_ma(memory), memory.lessons
        memory = replace(memory, settled_s=memory.settled_s + elapsed_s if arrived else 0.0, lessons=())
        if memory.settled_s >= self.judge.follows_s(memory):
            memory = self.judge.rested(memory, measured_m, elapsed_s)
        if memory.rest.readings:
            mean_m = memory.rest.mean_m
            mean_m2 = self.judge.reading_m2(memory, mean_m) / memory.rest.readings
            memory = replace(memory, position_m=mean_m, position_m2=mean_m2)
        else:
            position_m = memory.position_m + _TRACKING * (measured_m - memory.position_m)
            memory = replace(memory, position_m=position_m)
        direction = -1.0 if memory.move.direction < 0.0 else 1.0
        stuck = memory.move.stage is None or memory.rest.readings > 0
        return memory, Estimate(StemState(memory.position_m, 0.0, stuck, direction), lessons)

    # -- what to do

    def decide(
        self, memory: NmpcMemory, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[NmpcMemory, Decision]:
        """Return the memory after the decision, and the decision; the stiction table is read once."""
        del stem
        setpoint_m = observation.setpoint_m
        if self.keeps and not memory.has_read and observation.time_s >= self.table_from_s:
            belief = taught(memory.belief, table, self.valve, self.judge.sigma_m(memory.position_m))
            memory = replace(memory, belief=belief, has_read=True)
            memory = memory if self.braking is None else self.braking.taught(memory)
        if setpoint_m != memory.setpoint_m:
            memory = replace(memory, setpoint_m=setpoint_m, setpoint_m2=0.0, is_new=True, tries=0, pending=())
            memory = memory if self.braking is None else self.braking.aimed(memory, setpoint_m)
        ends_ma, left_m = (self.limits.low_ma, self.limits.high_ma), LEFT * self.valve.span_m
        setpoint_m = memory.belief.nearest_m(setpoint_m, self.judge.stem_m(memory), *ends_ma, left_m)
        reason: MoveReason | None = None
        move, failed, belief = memory.move, memory.failed, memory.belief
        if move.stage is None or (move.stage is Stage.RETURN and memory.is_new):
            memory, reason = self._considered(memory, setpoint_m)
        elif memory.pending and self.judge.is_away(memory):
            sigma_m = OF_READING * self.judge.noise_m(memory)
            memory = replace(memory, position_m=memory.smooth_m, position_m2=sigma_m * sigma_m)
            memory, reason = self._next(memory, setpoint_m)
            memory = replace(memory, move=replace(memory.move, is_hurried=True))
        elif memory.rest.readings and self.judge.is_judged(memory, setpoint_m):
            memory = self._followed(self.judge.settled(memory))
            if memory.settled_s:
                memory, reason = self._next(self._learned(memory, setpoint_m), setpoint_m)
        before, (move, current_ma) = memory.move.slip, self._sent(memory)
        step_ma, sent_ma = self.rate_ma_per_s * self.judge.period_s, memory.sent_ma
        current_ma = min(max(current_ma, sent_ma - step_ma), sent_ma + step_ma)
        bounds = Bounds(-math.inf, math.inf, self.limits.low_ma, self.limits.high_ma)
        motion = Motion.REST if move.stage is None else Motion.MOVE
        memory = replace(memory, move=move, sent_ma=current_ma)
        failed = memory.failed if memory.failed > failed else 0
        if memory.belief is not belief:
            memory = replace(memory, is_other=memory.belief.differs)
        differs = memory.is_other or memory.failed > _CHANCE
        passes = move.slip.solved - before.solved if move.slip is not None and before is not None else 0
        return memory, Decision(
            current_ma, bounds, motion, passes=passes, reason=reason, failed_pushes=failed, differs=differs
        )

    def _sent(self, memory: NmpcMemory) -> tuple[Move, float]:
        """Return the move, and the current in mA of the next sample."""
        move = memory.move
        if move.slip is not None and self.braking is not None:
            return self.braking.sent(memory, move, move.slip)
        if move.waits > 0:
            move = replace(move, waits=move.waits - 1)
            if self.judge.is_moving(memory):
                return replace(move, waits=0), move.level_ma
            return move if move.waits else self._boosted(memory, move), move.level_ma
        if move.boosted > 0 and not self.judge.is_near(memory):
            return replace(move, boosted=move.boosted - 1), move.boost_ma
        level_ma = self.limits.clipped(move.level_ma)  # what was applied when control began may be beyond
        is_same = move.boosted == 0 and level_ma == move.level_ma
        return move if is_same else replace(move, level_ma=level_ma, boosted=0), level_ma

    def _next(self, memory: NmpcMemory, setpoint_m: float) -> tuple[NmpcMemory, MoveReason | None]:
        """Return the memory after a move that has been judged, and why another one begins."""
        if memory.pending:
            return self._onward(memory, setpoint_m)
        if memory.move.stage not in (Stage.LAND, Stage.SLIP):
            return self._considered(replace(memory, move=replace(memory.move, stage=None)), setpoint_m)
        if memory.failed == 0 and memory.move.stage is Stage.LAND:
            memory = replace(memory, lasts_s=memory.move.since_s)
        elif memory.failed == 0 and memory.way_s > memory.move.since_s:
            memory = replace(memory, lasts_s=memory.way_s - memory.rest.duration_s)
        if self._is_worth_it(memory, setpoint_m) and memory.tries <= _MOST_MOVES:
            return self._planned(memory, setpoint_m)
        return self._left(replace(memory, is_new=False)), None

    def _onward(self, memory: NmpcMemory, setpoint_m: float) -> tuple[NmpcMemory, MoveReason | None]:
        """Return the memory after a move away, and why the next one begins."""
        step, *later = memory.pending
        if (braked := self._braked(memory, setpoint_m, by_reading=True)) is not None:
            return braked
        goes_no_farther = memory.move.level_ma in (self.limits.low_ma, self.limits.high_ma)
        is_far = can_follow(memory.belief, self.judge.stem_m(memory), step, self._through(memory))
        if not (goes_no_farther or is_far) and memory.tries <= _MOST_MOVES:
            return self._planned(memory, setpoint_m)
        return self._begun(replace(memory, pending=tuple(later)), step)

    def _left(self, memory: NmpcMemory) -> NmpcMemory:
        """Return the memory of a stem that stays: the pressure goes to the middle of its band, or stays at a limit."""
        move, noise = memory.move, memory.noise.after(memory.rest)
        if move.stage is Stage.SLIP:  # it is there
            return replace(memory, move=replace(move, stage=None))
        setpoint_m, ends_ma = memory.setpoint_m, (self.limits.low_ma, self.limits.high_ma)
        beyond_m = abs(setpoint_m - memory.belief.reachable_m(setpoint_m, *ends_ma))
        stays = min(abs(move.level_ma - end_ma) for end_ma in ends_ma) < _AT_LIMIT_MA
        stays = stays and beyond_m > LARGE * self.valve.span_m
        rests_ma = move.level_ma - (0.0 if stays else move.direction * memory.belief.sliding_ma)
        move = self._commanded(memory, Stage.RETURN, move.direction, move.target_m, rests_ma)
        return replace(memory, noise=noise, move=move, rest=NO_REST, settled_s=0.0)

    def _considered(self, memory: NmpcMemory, setpoint_m: float) -> tuple[NmpcMemory, MoveReason | None]:
        """Return the memory of a resting stem, and why a move begins, if one does."""
        if memory.carried is not None:
            is_brief = memory.rest.duration_s < LAND_S or memory.rest.blocks < LAND_BLOCKS
            if is_brief and not memory.is_new:
                return memory, None
            if not is_brief:
                from_m, from_m2 = memory.carried
                memory = self.ends.carried(memory, memory.position_m - from_m, from_m2)
            memory = replace(memory, carried=None)
        error_m = abs(setpoint_m - self.judge.stem_m(memory))
        if memory.is_new and (error_m < _NEW_TOLERANCE * self.valve.span_m or self._is_left(memory, setpoint_m)):
            return replace(memory, is_new=False), None
        if not memory.is_new and (memory.rest.readings < 2 or not self._is_worth_it(memory, setpoint_m)):  # noqa: PLR2004
            return memory, None
        sigma_m = math.sqrt(memory.position_m2) if memory.rest.readings else self.judge.noise_m(memory)
        if memory.move.stage is None and error_m < _HASTY * sigma_m and memory.rest.duration_s < _LONG_S:
            return memory, None
        if memory.tries > _MOST_MOVES:  # it was left
            is_due = memory.rest.duration_s > waits_s(memory.tries - _MOST_MOVES, moves=memory.failed == 0)
            if not (is_due and error_m > LEFT * self.valve.span_m):
                return memory, None
        return self._planned(memory, setpoint_m)

    def _is_left(self, memory: NmpcMemory, setpoint_m: float) -> bool:
        """Whether a new setpoint is near, and a move to it is expected to end farther from it than near."""
        near_m = LARGE * self.valve.span_m
        if abs(memory.setpoint_m - self.judge.stem_m(memory)) > near_m:  # also where the believed reach ends near it
            return False
        direction = self._steps_to(memory, setpoint_m)[-1].direction
        sigma_m = min(memory.belief.landing_sigma_m(setpoint_m, direction), memory.braked.read_m(direction))
        return _EXPECTED * sigma_m > near_m and (self.braking is None or self.braking.plan(memory, setpoint_m) is None)

    def _is_worth_it(self, memory: NmpcMemory, setpoint_m: float) -> bool:
        """Whether an error is seen, and a correction of it is worth while."""
        stem_m, span_m, tries = self.judge.stem_m(memory), self.valve.span_m, min(memory.tries, _MOST_MOVES + 1)
        if self.braking is not None and self.braking.is_worth_it(memory, setpoint_m):
            return True
        certain_m = CERTAIN * math.sqrt(memory.position_m2 + memory.setpoint_m2)
        if abs(setpoint_m - stem_m) <= max(tolerance_m(span_m, tries), certain_m):
            return False
        steps = self._steps_to(memory, setpoint_m)
        read_m = memory.braked.read_m(steps[-1].direction)
        return is_worth_it(memory.belief, steps, stem_m, setpoint_m, span_m, memory.lasts_s, tries, read_m)

    def _steps_to(self, memory: NmpcMemory, setpoint_m: float) -> tuple[Step, ...]:
        """Return the moves that lead to a setpoint."""
        stem_m, through, from_m = self.judge.stem_m(memory), self._through(memory), memory.braked.from_m
        return steps_to(memory.belief, self.limits, stem_m, setpoint_m, through, from_m)

    def _through(self, memory: NmpcMemory) -> float:
        """Return the slip jumps from which on a stem slides through, behind the slower one of the lags."""
        return self.judge.stem.slides_through(memory.belief.spring_ma_per_m, self._actuator(memory).slower_lag_s)

    def _actuator(self, memory: NmpcMemory) -> ActuatorParameters:
        """Return the actuator as it is believed."""
        actuator = self.valve.actuator.with_lag(memory.belief.lag_s)
        return replace(actuator, dead_time_s=memory.belief.dead_time_s)

    def _followed(self, memory: NmpcMemory) -> NmpcMemory:
        """Return the memory with what a move shows of the lag; not settled where the pressure is still on its way."""
        move, belief = memory.move, memory.belief
        knows_lag = self.braking is not None and self.braking.knows_lag(memory)
        is_jammed = memory.failed > 2 * _CHANCE
        says_nothing = (move.is_hurried or knows_lag) and not is_jammed
        if move.stage is Stage.RETURN or says_nothing:
            return replace(memory, hurries=False) if self.judge.is_beyond(memory) else memory
        direction = 1.0 if move.level_ma > move.from_ma else -1.0
        step_ma, spring = direction * (move.level_ma - move.from_ma), belief.spring_ma_per_m
        moved_m = direction * (self.judge.stem_m(memory) - move.start_m)
        variance_m2, worth = memory.noise.of(self.judge.sigma_m(memory.position_m))
        sigma_m = math.sqrt(memory.position_m2 + move.start_m2)
        if moved_m < self.judge.least_m(sigma_m):
            freed = direction * (move.level_ma - belief.balance_ma(move.start_m)) > belief.static_ma
            patience_s = MORE_PATIENCE_S if memory.unpushed or is_jammed else PATIENCE_S
            waits = (is_jammed or (freed and not memory.is_lag_known)) and move.since_s < patience_s
            return replace(memory, rest=NO_REST, settled_s=0.0) if waits else memory
        free_ma = direction * (belief.balance_ma(move.start_m) - move.from_ma) + belief.static_ma
        way = way_of(step_ma, free_ma, spring, moved_m, move.since_s)
        area_m_s = moved_m * move.since_s - direction * move.area_m_s
        noise_m2 = move.since_s * self.judge.period_s * variance_m2 * worth
        sigma_s = way.sigma_s(math.sqrt(noise_m2 + move.since_s * move.since_s * sigma_m * sigma_m))
        if move.is_hurried or knows_lag or memory.is_blind or _SEEN * sigma_s > _OF_MOVE * move.since_s:
            return memory
        actuator, seen_s = self._actuator(memory), way.lag_s(area_m_s)
        believed_s, rising_s = replace(self.valve, actuator=actuator).lag_s, actuator.lag_s(fills=True)
        memory = replace(memory, is_lag_known=True, hurries=seen_s > _SHORTER * believed_s)
        is_other = belief.lag_s != lag_s_of(belief.configured)
        more_s = more_lag_s(believed_s, seen_s, self.judge.period_s + _SEEN * sigma_s, is_other=is_other)
        if more_s == 0.0:
            return replace(memory, unpushed=None)
        behind_ma = move.level_ma - direction * way.after_ma(believed_s + more_s)
        part = rising_s / actuator.slower_lag_s if rising_s else 1.0
        other = memory.behind(max(rising_s + part * more_s, 0.0), behind_ma)
        likelier = other if self.braking is None else self.braking.likelier(other, memory)
        has_arrived = likelier is not other or abs(behind_ma - move.level_ma) <= self.judge.near_ma(other)
        return likelier if has_arrived else replace(likelier, rest=NO_REST, settled_s=0.0)

    def _learned(self, memory: NmpcMemory, setpoint_m: float) -> NmpcMemory:
        """Return the memory with what a move teaches."""
        if self.braking is None:
            return self.ends.landed(memory)
        memory, slip = self.braking.studied(memory), memory.move.slip
        if slip is None:
            return self.braking.prepared(self.ends.landed(memory), setpoint_m)
        memory = self.braking.slipped(memory, slip)
        if self.keeps:
            position_m, direction = self.judge.stem_m(memory), slip.task.direction
            landing = Landing(position_m, direction, memory.belief.landing_ma(position_m, direction))
            memory = replace(memory, lessons=(lesson_of(memory.belief, landing, self.valve),))
        return self.braking.prepared(memory, setpoint_m)

    def _planned(self, memory: NmpcMemory, setpoint_m: float) -> tuple[NmpcMemory, MoveReason | None]:
        """Return the memory in which the first move to the setpoint has begun, and why."""
        memory = replace(
            memory,
            is_new=False,
            tries=memory.tries + 1,
            way_s=0.0,
            noise=memory.noise.after(memory.rest),
            belief=memory.belief.after_move(memory.braked.changes),
        )
        if (braked := self._braked(memory, setpoint_m)) is not None:
            return braked
        step, *later = self._steps_to(memory, setpoint_m)
        return self._begun(replace(memory, pending=tuple(later)), step)

    def _begun(self, memory: NmpcMemory, step: Step) -> tuple[NmpcMemory, MoveReason | None]:
        """Return the memory in which a move has begun, and why it begins."""
        belief, pressure = memory.belief, memory.pressure
        start_m, direction = self.judge.stem_m(memory), step.direction
        level_m = step.target_m
        if step.stage is Stage.AWAY and memory.pending and self.judge.is_sure(memory):
            level_m += direction * 2.0 * CERTAIN * OF_READING * self.judge.noise_m(memory)
        level_ma = belief.landing_ma(level_m, direction)
        if step.stage is Stage.AWAY:
            level_ma = belief.at_least_freeing_ma(level_ma, start_m, direction)
        move = self._commanded(memory, step.stage, direction, step.target_m, level_ma)
        if pressure is not None:
            move = self._hurried(memory, move)
            lag_s = self._actuator(memory).lag_s(fills=direction > 0.0)
            swings = self.judge.stem.swings(belief.spring_ma_per_m, lag_s)
            if step.stage is Stage.LAND and swings:
                beyond_m = direction * inertia_m(self.plant, belief, pressure, move, self.judge.period_s)
                level_ma = self.limits.clipped(move.level_ma - belief.spring_ma_per_m * beyond_m)
                move = replace(move, inertia_m=beyond_m, level_ma=level_ma)
        reason = belief.reason(start_m, step.target_m, direction, self.valve.force_gain_n_per_ma)
        goes_on = memory.move.stage is Stage.AWAY and not memory.rest.readings
        memory = replace(memory, move=move, rest=NO_REST, settled_s=0.0)
        return memory if self.braking is None else self.braking.with_way(memory, goes_on=goes_on), reason

    def _braked(
        self, memory: NmpcMemory, setpoint_m: float, *, by_reading: bool = False
    ) -> tuple[NmpcMemory, MoveReason] | None:
        """Return the memory in which a braked move has begun, and why it begins; None where none is made.

        by_reading: whether only one that is braked by reading will do.
        """
        found = None if self.braking is None else self.braking.plan(memory, setpoint_m)
        if self.braking is None or found is None or (by_reading and not found[0].by_reading):
            return None
        slip, task, belief = found[0], found[0].task, memory.belief
        move = self._commanded(memory, Stage.SLIP, task.direction, setpoint_m, task.hold_ma)
        reason = belief.reason(task.start_m, setpoint_m, task.direction, self.valve.force_gain_n_per_ma)
        move = replace(move, slip=slip, is_hurried=True)
        memory = replace(memory, move=move, rest=NO_REST, settled_s=0.0, pending=())
        return self.braking.with_track(memory, slip), reason

    def _commanded(self, memory: NmpcMemory, stage: Stage, direction: float, target_m: float, level_ma: float) -> Move:
        """Return a move to a level, from where the stem is now."""
        before_ma = memory.move.level_ma
        from_ma = before_ma if memory.pressure is None else memory.behind_ma
        start_m, near_m = self.judge.stem_m(memory), margin_m(memory.belief)
        level_ma = self.limits.clipped(level_ma)
        return Move(stage, direction, target_m, level_ma, before_ma, from_ma, start_m, memory.position_m2, near_m)

    def _hurried(self, memory: NmpcMemory, move: Move) -> Move:
        """Return the move whose current stays at its limit at first, where the pressure lags.

        While no move has shown the lag, the level is commanded before it: it moves a stem at once where none is there.
        """
        if memory.is_lag_known or not memory.hurries:
            return self._boosted(memory, move)
        judge = self.judge
        shows_s = judge.stem.shows_after_s(memory.belief.spring_ma_per_m) + judge.valve.sensor_time_constant_s
        return replace(move, waits=2 + math.ceil(shows_s / judge.period_s))

    def _boosted(self, memory: NmpcMemory, move: Move) -> Move:
        """Return the move with the samples in which the current stays at its limit."""
        from_ma = memory.behind_ma
        fills = move.level_ma > from_ma
        lag_s = self._actuator(memory).lag_s(fills=fills) if memory.hurries else 0.0
        if lag_s <= _LAG_SAMPLES * self.judge.period_s:
            return move
        boost_ma = self.limits.high_ma if fills else self.limits.low_ma
        whole_ma, step_ma = boost_ma - from_ma, move.level_ma - from_ma
        samples = boost_samples(lag_s, self.judge.period_s, whole_ma, step_ma, LEFT_OF_STEP[move.stage])
        return replace(move, boost_ma=boost_ma, boosted=samples, is_hurried=samples > 0)
