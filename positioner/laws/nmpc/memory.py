"""What the law `quasi-static` carries from cycle to cycle. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.values import dataclass, replace

if TYPE_CHECKING:
    from positioner.laws.nmpc.belief import ValveBelief
    from positioner.laws.nmpc.move import Stage, Step
    from positioner.laws.nmpc.rest import Noise, Rest
    from positioner.laws.nmpc.slip import SlipPlan
    from positioner.laws.nmpc.study import Way
    from positioner.laws.nmpc.track import Track
    from positioner.valve.pressure import PressureState
    from positioner.valve.stiction import LearnedSample

_SAME_MA = 0.05
"""Less turns no push round, which takes the friction of both directions; what was learned changes a level, too."""


@dataclass(frozen=True, slots=True)
class Move:
    """The move that is made; at rest, in the middle of the stick band, the last one without its stage.

    level_ma, before_ma: the level, and the one before it. from_ma: pressure at the begin. start_m, start_m2: where the
    stem was, and the variance of that. boost_ma, boosted: the limit, and for how many samples more it is commanded;
    waits: for how many its level is commanded before that, to see whether the pressure lags at all. inertia_m: how far
    mass was expected to carry the stem beyond its balance, with the sign of the direction. margin_m: how far from its
    target a move away may end. since_s: its age. area_m_s: the integral of the readings from where it began.
    is_hurried: it began at the limit of the current. slip: of a braked move; sent: how many of its currents.
    """

    stage: Stage | None
    direction: float
    target_m: float
    level_ma: float
    before_ma: float
    from_ma: float
    start_m: float
    start_m2: float
    margin_m: float
    boost_ma: float = 0.0
    boosted: int = 0
    waits: int = 0
    inertia_m: float = 0.0
    since_s: float = 0.0
    area_m_s: float = 0.0
    is_hurried: bool = False
    slip: SlipPlan | None = None
    sent: int = 0

    @property
    def pushes(self) -> float:
        """Direction in which its level pushes the stem, ±1; nearly the same level again pushes on."""
        change_ma = self.level_ma - self.before_ma
        return math.copysign(1.0, change_ma) if abs(change_ma) > _SAME_MA else self.direction


@dataclass(frozen=True, slots=True)
class Braked:
    """What braked moves carry.

    planned: variance of stops that are planned, over the square of their way, at most 1: where long ways miss by a
    tenth of them, short ones do so, too. reading_m2: variance of stops that are braked by reading.
    from_m: how far away from the setpoint these begin, upwards and downwards; 0 where none is made. changes, roams:
    variance by which forces and friction change from move to move, and friction on the way, over what is expected;
    left_part: of the rollout's variance, what is left of ways, at first a tenth of its σ. way: of the move; track: of a
    braked one.
    """

    planned: float = 0.0
    reading_m2: float = 0.0
    from_m: tuple[float, float] = (0.0, 0.0)
    changes: float = 1.0
    roams: float = 1.0
    left_part: float = 0.01
    way: Way | None = None
    track: Track | None = None

    def read_m(self, direction: float) -> float:
        """Return σ of a stop that is braked by reading at the end of a way in a direction, infinite where none is."""
        return math.sqrt(self.reading_m2) if self.from_m[direction < 0.0] > 0.0 else math.inf

    def missed(self, missed_m: float, way_m: float, *, by_reading: bool) -> Braked:
        """Return this after a stop at the end of a way that was so far from its place that it teaches nothing else."""
        square_m2 = missed_m * missed_m
        if by_reading:
            return replace(self, reading_m2=max(self.reading_m2, square_m2))
        return replace(self, planned=max(self.planned, min(square_m2 / (way_m * way_m), 1.0)))


@dataclass(frozen=True, slots=True)
class NmpcMemory:
    """What the law carries.

    belief, noise: of the valve and of the sensor. pressure: of the model, None before the first command is known. rest:
    the readings since the stem rests. settled_s: for how long the pressure has arrived. position_m, position_m2: the
    place of the stem, and its variance. smooth_m: the smoothed reading. sent_ma: the last current. setpoint_m2: the
    variance of the setpoint, where it is the reading with which control began. pending: moves that are still to be
    made. tries: to this setpoint; failed: pushes in a row that have not moved the stem.
    later_s: what rests are waited for beyond the model. way_s: since the way to a setpoint began; lasts_s: how long one
    lasts, of the last quasi-static move or of the last whole way whose end was braked, until the stem rested.
    is_lag_known: a move has shown it; hurries: and it was no shorter than believed. carried: where a resting stem was
    before it moved under a current that stood still, and the variance of that; None if it has not moved. has_read: the
    stiction table, at the start; lessons: what it is to learn. unpushed: the belief before the pushes in vain while no
    move has shown the lag. is_other: another valve than the configured one was measured. braked: what braked moves
    carry.
    """

    belief: ValveBelief
    noise: Noise
    move: Move
    rest: Rest
    pressure: PressureState | None
    position_m: float
    position_m2: float
    smooth_m: float
    sent_ma: float = 0.0
    settled_s: float = 1.0
    setpoint_m: float = 0.0
    setpoint_m2: float = 0.0
    is_new: bool = False
    tries: int = 0
    pending: tuple[Step, ...] = ()
    hurries: bool = False
    later_s: float = 0.0
    is_lag_known: bool = False
    way_s: float = 0.0
    lasts_s: float = 0.0
    failed: int = 0
    is_other: bool = False
    carried: tuple[float, float] | None = None
    unpushed: ValveBelief | None = None
    braked: Braked = Braked()
    has_read: bool = False
    lessons: tuple[LearnedSample, ...] = ()

    def knowing(self, before: NmpcMemory) -> NmpcMemory:
        """Return the memory with what another one has learned of the valve and of the sensor."""
        return replace(
            self,
            belief=before.belief,
            noise=before.noise,
            hurries=before.hurries,
            later_s=before.later_s,
            is_lag_known=before.is_lag_known,
            is_other=before.is_other,
            unpushed=before.unpushed,
            braked=replace(before.braked, way=None, track=None),
            has_read=before.has_read,
        )

    def held(self, belief: ValveBelief) -> NmpcMemory:
        """Return the memory after a push in vain, which has led to a belief."""
        unpushed = None if self.is_lag_known else self.unpushed or self.belief
        return replace(self, belief=belief, unpushed=unpushed)

    @property
    def behind_ma(self) -> float:
        """The pressure, in mA; what was sent, before one is known."""
        return self.sent_ma if self.pressure is None else self.pressure.pressure_ma

    @property
    def is_blind(self) -> bool:
        """Whether the move says nothing of the lag: it goes on with the way of a push in vain before it."""
        step_ma = abs(self.move.level_ma - self.move.from_ma)
        return self.unpushed is not None and step_ma < 2.0 * self.belief.sliding_ma

    def behind(self, lag_s: float, behind_ma: float) -> NmpcMemory:
        """Return the memory of another lag; where it is longer, what was pushed in vain was only pushed too short."""
        belief = self.unpushed if self.unpushed and lag_s > self.belief.lag_s else self.belief
        pressure = None if self.pressure is None else replace(self.pressure, pressure_ma=behind_ma)
        return replace(self, belief=belief.with_lag(lag_s), unpushed=None, pressure=pressure, later_s=0.0)
