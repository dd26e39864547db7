"""Where a move to a level ends, and what that teaches of the valve. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.nmpc.belief import Landing
from positioner.laws.nmpc.kept import lesson_of
from positioner.laws.nmpc.move import Stage
from positioner.laws.nmpc.slip import numbers_of
from positioner.laws.nmpc.stop import Task, stop_of
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.belief import ValveBelief
    from positioner.laws.nmpc.judging import Judge
    from positioner.laws.nmpc.memory import Move, NmpcMemory
    from positioner.laws.nmpc.move import Limits
    from positioner.valve.pressure import PressureState
    from positioner.valve.rollout import Plant

_SLID = 0.9
"""Of F_c: a push beyond it may have moved the stem, so that its place is a landing."""
_PUSHED = 0.6
"""Of F_s: a weaker push that moved nothing teaches nothing."""
_FREED = 0.5
"""Of the slip jump: a stem that a force frees slides at least through it, as far as F_s and F_c are known. Noise that
is alike from reading to reading moves a rest by less, and would be taken for a force of several mA."""
_SLIDES = 0.25
"""Of the way that a stem without friction slides back while the pressure goes to the middle of its band: where it goes
a quarter of that, friction is 3/8 of what is believed."""
_OF_GAP, _OF_AWAY, _OF_INERTIA = 0.3, 0.04, 0.25
"""Doubt of the balance: 30 % of what the pressure lacks, 4 % of the step of a move away (its pressure is not waited
for), a quarter of what mass has added."""


def landing_of(
    move: Move, position_m: float, direction: float, pressure_ma: float, spring_ma_per_m: float
) -> tuple[Landing, float]:
    """Return where a move has ended, less what mass has added, and the variance of its pressure in mA².

    Args:
        move: the move.
        position_m: where the stem rests.
        direction: of the stem, +1 or -1.
        pressure_ma: as the model says.
        spring_ma_per_m: k = K/B.
    """
    gap_ma = _OF_GAP * (move.level_ma - pressure_ma)
    if move.stage is Stage.AWAY:
        other_ma = _OF_AWAY * (move.level_ma - move.before_ma)
    else:
        other_ma = _OF_INERTIA * spring_ma_per_m * move.inertia_m
    return Landing(position_m - move.inertia_m, direction, pressure_ma), gap_ma * gap_ma + other_ma * other_ma


def inertia_m(plant: Plant, belief: ValveBelief, pressure: PressureState, move: Move, period_s: float) -> float:
    """Return how far mass carries the stem of a move beyond the balance of its level, in its direction; 0 if not.

    Args:
        plant: the configured valve.
        belief: what is believed of it.
        pressure: now.
        move: the move, which begins.
        period_s: of a sample.
    """
    direction, level_ma = move.direction, move.level_ma
    plain_m = belief.slides_to_m(level_ma, direction)
    local_ma = belief.local_ma(plain_m, direction)
    rollout = plant.rollout(numbers_of(belief.numbers.mean, local_ma))
    task = Task(pressure, move.start_m, plain_m, move.boost_ma, level_ma, level_ma, 0.0, 0.0, period_s)
    stop = stop_of(rollout, task, (move.boost_ma,) * move.boosted)
    beyond_m = direction * (stop.position_m - plain_m + local_ma / belief.spring_ma_per_m)
    return max(beyond_m, 0.0) if stop.is_held and stop.freed >= 0 else 0.0


@dataclass(frozen=True, slots=True)
class MoveEnds:
    """What the ends of moves teach of one valve. keeps: the stiction table learns them, too."""

    judge: Judge
    limits: Limits
    keeps: bool

    def landed(self, memory: NmpcMemory) -> NmpcMemory:
        """Return the memory with what the end of a move teaches: a landing, or a push that moved nothing."""
        move, belief, position_m = memory.move, memory.belief, self.judge.stem_m(memory)
        direction = move.pushes
        if memory.pressure is None:
            return memory
        moved_m, sigma_m = position_m - move.start_m, math.sqrt(memory.position_m2 + move.start_m2)
        if move.stage is Stage.RETURN:
            return self.carried(memory, moved_m, move.start_m2)
        push_ma = direction * (move.level_ma - belief.balance_ma(move.start_m))
        is_held, has_moved = self.limits.holds(position_m, direction), direction * moved_m > self.judge.least_m(sigma_m)
        if has_moved:
            if push_ma <= _SLID * belief.sliding_ma:
                return self.carried(replace(memory, failed=0), moved_m, move.start_m2)
            if not move.is_hurried:
                belief = belief.freed(move.start_m, direction, move.level_ma)
            memory = replace(memory, failed=0, belief=belief)
            landing, doubt_ma2 = landing_of(move, position_m, direction, memory.behind_ma, belief.spring_ma_per_m)
            if is_held:
                return replace(memory, belief=belief.ran_on(landing))
            belief = belief.landed(landing, memory.position_m2, doubt_ma2)
            if self.keeps and move.stage is Stage.LAND:
                memory = replace(memory, lessons=(lesson_of(belief, landing, self.judge.valve),))
        elif not is_held and direction * (move.level_ma - belief.balance_ma(position_m)) > _PUSHED * belief.static_ma:
            memory = replace(memory, failed=memory.failed + 1)  # also where a force moved it back
            return memory.held(belief.held(position_m, direction, move.level_ma))
        return replace(memory, belief=belief)

    def carried(self, memory: NmpcMemory, moved_m: float, from_m2: float) -> NmpcMemory:
        """Return the memory after a stem has moved that nothing should have moved: this is a landing, too.

        A force has moved it; or, where it slid with the pressure, less friction than believed has not held it. One that
        goes on with its landing, by less than a slip jump, does so at that pressure: no force of F_c need have come.

        Args:
            memory: of the stem where it rests now.
            moved_m: how far it has moved.
            from_m2: variance of the place where it was.
        """
        move, belief, direction = memory.move, memory.belief, 1.0 if moved_m > 0.0 else -1.0
        position_m = memory.position_m + 0.5 * direction * self.judge.valve.backlash_m
        is_force = move.stage is None or direction != move.pushes
        least_m = self.judge.least_m(math.sqrt(memory.position_m2 + from_m2))
        if is_force:
            least_m = max(least_m, _FREED * belief.jump_m)
        elif move.stage is Stage.RETURN:
            least_m = max(least_m, _SLIDES * abs(move.level_ma - move.before_ma) / belief.spring_ma_per_m)
        if abs(moved_m) < least_m or self.limits.holds(position_m, direction):
            return memory
        goes_on = move.stage is Stage.RETURN and direction == move.direction and abs(moved_m) < belief.jump_m
        landing = Landing(position_m, direction, move.before_ma if goes_on else memory.behind_ma)
        belief = belief.landed(landing, memory.position_m2, 0.0, is_force=is_force)
        if not is_force:
            belief = belief.freed(move.start_m, direction, move.level_ma)
        return replace(memory, belief=belief, move=replace(move, direction=direction))
