"""When a stem rests, where it is, and whether its readings are enough to go on. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.estimator_settings import measurement_sigma_m
from positioner.laws.nmpc.move import LARGE, LEFT_OF_STEP, Stage, tolerance_m
from positioner.laws.nmpc.rest import NO_REST
from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.laws.estimator_settings import EstimatorSettings
    from positioner.laws.nmpc.memory import NmpcMemory
    from positioner.laws.nmpc.move import Stem
    from positioner.valve.parameters import ValveParameters

CERTAIN = 2.2
"""σ of the mean of the readings that an error must exceed."""
OF_READING = 0.5
"""σ of the smoothed reading over that of a reading, whose newest counts 0.35: √(0.35/1.65) = 0.46."""
LAND_S, LAND_BLOCKS = 0.04, 3
_AWAY_S, _AWAY_BLOCKS, _ENOUGH_S = 0.02, 2, 0.25
"""Least length of a rest before it is judged, in s and in blocks of readings, and the length that is always enough."""
_OF_TOLERANCE, _OF_SEEN = 0.25, 0.15
"""A landing is judged once σ of the mean is a quarter of the tolerance, or 15 % of the error; after 0.25 s at last."""
_FOLLOWED, _FOLLOWED_S = 4.0, 0.03
"""The stem follows within four of its time constants, e⁻⁴ = 2 %, and 30 ms."""
_ARRIVED_MA = 0.01
"""So near to its level the pressure has arrived: 0.05 % of span on the paper's valve."""
_OF_STEP, _OF_ERROR, _OF_MARGIN = 0.05, 0.1, 0.3
"""Earlier where less matters: 5 % of the step, a tenth of the error that is seen, a third of a margin."""
_LATER, _FIRST_LATER, _MOST_LATER_S = 1.4, 0.25, 1.0
"""A stem that moves in its rest needs longer: 1.4 times what was added, at least a quarter of the move, at most 1 s."""
_SOONER = 0.7
"""Of what was added each rest in which the stem does not move takes 30 % back, where moves have shown the lag: then it
was a force."""
_SURE = 0.008
"""Of span: σ of a landing up to which a move away is not measured: it ends as soon as it is seen to be far enough."""
_MOVED, _MOVED_M = 3.0, 1e-4
"""σ of a difference of two means, and its least, that say that the stem has moved."""


@dataclass(frozen=True, slots=True)
class Judge:
    """The constants of one valve by which its readings are judged."""

    valve: ValveParameters
    estimator: EstimatorSettings
    stem: Stem
    period_s: float

    def sigma_m(self, position_m: float) -> float:
        """Return the configured σ of a reading in m at a place."""
        return measurement_sigma_m(self.estimator, self.valve, position_m)

    def noise_m(self, memory: NmpcMemory) -> float:
        """Return σ of a reading, as the rests have shown it."""
        variance_m2, _ = memory.noise.of(self.sigma_m(memory.smooth_m))
        return math.sqrt(variance_m2)

    def reading_m2(self, memory: NmpcMemory, position_m: float) -> float:
        """Return the variance of a reading at a place, of which many make a mean, as the rests have shown it."""
        variance_m2, worth = memory.noise.of(self.sigma_m(position_m))
        return variance_m2 * worth

    def stem_m(self, memory: NmpcMemory) -> float:
        """Return the place of the stem: backlash is taken up in the direction of the last move."""
        return memory.position_m + 0.5 * memory.move.direction * self.valve.backlash_m

    def least_m(self, sigma_m: float) -> float:
        """Return the difference of two means, whose σ is given, that says that the stem has moved."""
        return max(_MOVED * sigma_m, _MOVED_M) + self.valve.backlash_m

    def near_ma(self, memory: NmpcMemory) -> float:
        """Return how near to its level the pressure must be: where the stem can be judged."""
        move, spring = memory.move, memory.belief.spring_ma_per_m
        if move.stage is Stage.AWAY:
            return _OF_MARGIN * spring * move.margin_m
        if move.stage is Stage.LAND and memory.rest.readings:
            aim_m = memory.setpoint_m if memory.is_new else move.target_m  # a new one need not wait for this landing
            return max(_ARRIVED_MA, _OF_ERROR * spring * abs(aim_m - memory.position_m))
        if move.stage in (Stage.LAND, Stage.RETURN):
            return _ARRIVED_MA + _OF_STEP * abs(move.level_ma - move.before_ma)
        return _ARRIVED_MA

    def follows_s(self, memory: NmpcMemory) -> float:
        """Return how long after the pressure has arrived the stem and its sensor have followed."""
        stem = self.stem
        follows_s = stem.viscous / memory.belief.spring_ma_per_m + stem.mass / stem.viscous
        if memory.move.stage is Stage.SLIP:  # it is braked
            return follows_s + _FOLLOWED * self.valve.sensor_time_constant_s + memory.later_s
        return _FOLLOWED * (follows_s + self.valve.sensor_time_constant_s) + _FOLLOWED_S + memory.later_s

    def rested(self, memory: NmpcMemory, measured_m: float, elapsed_s: float) -> NmpcMemory:
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

    def settled(self, memory: NmpcMemory) -> NmpcMemory:
        """Return the memory with the place of the last readings, where those before were of a stem that crept."""
        variance_m2, worth = memory.noise.of(self.sigma_m(memory.position_m))
        position_m, readings = memory.rest.latest(self.period_s, variance_m2, worth)
        later_s = memory.later_s * (_SOONER if memory.is_lag_known else 1.0)
        return replace(memory, position_m=position_m, position_m2=variance_m2 * worth / readings, later_s=later_s)

    def is_judged(self, memory: NmpcMemory, setpoint_m: float) -> bool:
        """Whether the readings since the end of a move are enough to go on."""
        rest, stage = memory.rest, memory.move.stage
        if stage not in (Stage.LAND, Stage.SLIP):
            return stage is Stage.RETURN or (rest.duration_s >= _AWAY_S and rest.blocks >= _AWAY_BLOCKS)
        if rest.duration_s < LAND_S or rest.blocks < LAND_BLOCKS:
            return False
        error_m, sigma_m = abs(setpoint_m - self.stem_m(memory)), math.sqrt(memory.position_m2)
        least_m = max(_OF_TOLERANCE * tolerance_m(self.valve.span_m, memory.tries), _OF_SEEN * error_m)
        return sigma_m < least_m or rest.duration_s > _ENOUGH_S

    def is_sure(self, memory: NmpcMemory) -> bool:
        """Whether the move that is to be made next ends where it should, as far as is known."""
        step = memory.pending[0]
        return memory.belief.landing_sigma_m(step.target_m, step.direction) < _SURE * self.valve.span_m

    def is_away(self, memory: NmpcMemory) -> bool:
        """Whether a stem that moves away is far enough for the next move, and its end is not to be measured."""
        move = memory.move
        if move.stage is not Stage.AWAY or not self.is_sure(memory):
            return False
        return self._is_seen_within(memory, move.margin_m)

    def is_moving(self, memory: NmpcMemory) -> bool:
        """Whether the smoothed reading shows that the stem has left the place where its move began."""
        least_m = self.least_m(OF_READING * self.noise_m(memory))
        return abs(memory.smooth_m - memory.move.start_m) > least_m

    def is_near(self, memory: NmpcMemory) -> bool:
        """Whether the reading shows that a hurried pressure is as far as it should be hurried."""
        move = memory.move
        step_ma = abs(move.level_ma - move.from_ma)
        return self._is_seen_within(memory, LEFT_OF_STEP[move.stage] * step_ma / memory.belief.spring_ma_per_m)

    def _is_seen_within(self, memory: NmpcMemory, left_m: float) -> bool:
        """Whether the reading shows that the stem has at most this way left to the target of its move."""
        move = memory.move
        missing_m = move.direction * (move.target_m - memory.smooth_m)
        return missing_m < left_m - CERTAIN * OF_READING * self.noise_m(memory)

    def is_beyond(self, memory: NmpcMemory) -> bool:
        """Whether a hurried move has gone too far: the lag is shorter than believed."""
        move, beyond_m = memory.move, memory.move.direction * (self.stem_m(memory) - memory.move.target_m)
        landing_m = _MOVED * memory.belief.landing_sigma_m(move.target_m, move.direction)
        return move.is_hurried and beyond_m > max(LARGE * self.valve.span_m, landing_m)
