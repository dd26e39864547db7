"""Two moves to a setpoint (Srinivasan and Rengaswamy 2008, Comput. Chem. Eng. 32, 218-229). Pure.

    1  u = (K (r + b) + s F_c) / B   frees the stem, which slides until the spring and F_c balance the force: at r + b
    2  u =  K r / B                  the middle of the stick band: the stem stays where the first move left it

s is the direction of the move. Where r is closer than the slip jump (F_s - F_c) / K the first move cannot free the
stem, so that the law first moves the stem away from r. In open loop b is 0, and the parameters must be exact. The
retries are not in that paper: the place where the stem comes to rest corrects b, for each direction, and the law makes
the moves again.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING, Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable
from positioner.laws.bounds import Bounds
from positioner.laws.law import Decision
from positioner.laws.rivals.model_free import report
from positioner.values import dataclass, replace
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from positioner.laws.law import Estimate, Observation
    from positioner.valve.parameters import ValveParameters
    from positioner.valve.state import StemState
    from positioner.valve.stiction import StictionTable

_REACH = 1.15
"""A move over this many slip jumps certainly frees the stem."""
_INSTANT_S = 1e-9
"""Rounding of a sum of periods."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TwoMoveSettings(SettingsTable):
    """The `[control.two_move]` table.

    move_s: how long a move takes.
    back_off_m: how far the stem is moved away from a setpoint that is too close; more than 1.15 slip jumps.
    """

    move_s: Annotated[float, Interval(gt=0.0, le=60.0)]
    back_off_m: Annotated[float, Interval(gt=0.0, le=0.5)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TwoMoveRetrySettings(SettingsTable):
    """The `[control.two_move_retry]` table: the moves, and the conditions of a retry.

    moves: the moves of the law `two-move`.
    averaging_s: how long readings are averaged after a move before the law looks at the error.
    tolerance_m: error that is left as it is.
    most_retries: the largest number of retries for one setpoint.
    learning_gain: the part of the error that is added to b, the offset of the next move.
    """

    moves: TwoMoveSettings
    averaging_s: Annotated[float, Interval(gt=0.0, le=600.0)]
    tolerance_m: Annotated[float, Interval(ge=0.0, le=0.1)]
    most_retries: Annotated[int, Interval(ge=0, le=1000)]
    learning_gain: Annotated[float, Interval(ge=0.0, le=2.0)]


class Stage(Enum):
    """The stages of the moves to a setpoint."""

    REST = "rest"
    BACK_OFF = "back off"
    APPROACH = "approach"


@dataclass(frozen=True, slots=True)
class TwoMoveMemory:
    """What the law carries.

    setpoint_m: the setpoint that the law pursues; retries: how often it made the moves to it again.
    since_s: age of the stage. away_m: the end of a back-off. direction: ±1, of the approach, 0 before the first.
    position_m, readings: average and number of the readings since the stem rests.
    opening_bias_m, closing_bias_m: b for each direction.
    """

    setpoint_m: float
    position_m: float
    stage: Stage = Stage.REST
    since_s: float = 0.0
    away_m: float = 0.0
    direction: float = 0.0
    readings: int = 0
    retries: int = 0
    opening_bias_m: float = 0.0
    closing_bias_m: float = 0.0

    def bias_m(self, direction: float) -> float:
        """Return b in m for approaches in `direction`."""
        return self.opening_bias_m if direction > 0.0 else self.closing_bias_m


@dataclass(frozen=True, slots=True)
class TwoMoveLaw:
    """The law; open loop if `retry` is None."""

    name: str
    valve: ValveParameters
    moves: TwoMoveSettings
    retry: TwoMoveRetrySettings | None
    current_low_ma: float
    current_high_ma: float

    def begin(self, measured_m: float) -> TwoMoveMemory:
        """Return the memory of a stem that rests where it was measured."""
        return TwoMoveMemory(min(max(measured_m, self.valve.travel_min_m), self.valve.travel_max_m), measured_m)

    def estimate(self, memory: TwoMoveMemory, observation: Observation) -> tuple[TwoMoveMemory, Estimate]:
        """Return the memory and the position: the average while the stem rests, else the reading."""
        readings = memory.readings + 1 if memory.stage is Stage.REST else 1
        position_m = memory.position_m + (observation.measured_m - memory.position_m) / readings
        since_s = memory.since_s + observation.elapsed_s
        memory = replace(memory, position_m=position_m, readings=readings, since_s=since_s)
        return memory, report(position_m, 0.0)

    def decide(
        self, memory: TwoMoveMemory, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[TwoMoveMemory, Decision]:
        """Return the memory, and the current of the present stage; the table is not used."""
        del table
        setpoint_m = observation.setpoint_m
        if setpoint_m != memory.setpoint_m:
            memory = self._start(replace(memory, setpoint_m=setpoint_m, retries=0), stem.position_m)
        elif memory.stage is not Stage.REST and memory.since_s >= self.moves.move_s - _INSTANT_S:
            after = Stage.APPROACH if memory.stage is Stage.BACK_OFF else Stage.REST
            memory = replace(memory, stage=after, since_s=0.0, readings=0)
        elif self.retry is not None and self._is_worth_a_retry(self.retry, memory, setpoint_m - stem.position_m):
            memory = self._start(_corrected(self.retry, memory, setpoint_m - stem.position_m), stem.position_m)
        current_ma = min(max(self._current_ma(memory), self.current_low_ma), self.current_high_ma)
        bounds = Bounds(-math.inf, math.inf, self.current_low_ma, self.current_high_ma)
        return memory, Decision(current_ma, bounds, Motion.REST if memory.stage is Stage.REST else Motion.MOVE)

    def _start(self, memory: TwoMoveMemory, position_m: float) -> TwoMoveMemory:
        """Return the memory at the beginning of the moves to its setpoint."""
        direction = 1.0 if memory.setpoint_m > position_m else -1.0
        jump_m = (self.valve.static_friction_n - self.valve.coulomb_friction_n) / self.valve.spring_rate_n_per_m
        is_far = abs(memory.setpoint_m - position_m) > _REACH * jump_m
        stage = Stage.APPROACH if is_far else Stage.BACK_OFF
        away_m = position_m - direction * self.moves.back_off_m
        return replace(memory, stage=stage, since_s=0.0, away_m=away_m, direction=direction, readings=0)

    def _is_worth_a_retry(self, retry: TwoMoveRetrySettings, memory: TwoMoveMemory, error_m: float) -> bool:
        return (
            memory.stage is Stage.REST
            and memory.direction != 0.0
            and memory.retries < retry.most_retries
            and memory.since_s >= retry.averaging_s - _INSTANT_S
            and abs(error_m) > retry.tolerance_m
        )

    def _current_ma(self, memory: TwoMoveMemory) -> float:
        """Return the current in mA that balances the spring at the end of the stage, and in a move friction, too."""
        friction_ma = memory.direction * self.valve.coulomb_friction_n / self.valve.force_gain_n_per_ma
        match memory.stage:
            case Stage.BACK_OFF:
                away_m = memory.away_m + memory.bias_m(-memory.direction)
                return self.valve.balance_current_ma(away_m) - friction_ma
            case Stage.APPROACH:
                target_m = memory.setpoint_m + memory.bias_m(memory.direction)
                return self.valve.balance_current_ma(target_m) + friction_ma
            case Stage.REST:
                return self.valve.balance_current_ma(memory.setpoint_m)


def _corrected(retry: TwoMoveRetrySettings, memory: TwoMoveMemory, error_m: float) -> TwoMoveMemory:
    """Return the memory, the b of its last approach corrected, for one more try."""
    bias_m = memory.bias_m(memory.direction) + retry.learning_gain * error_m
    memory = replace(memory, retries=memory.retries + 1)
    return replace(memory, opening_bias_m=bias_m) if memory.direction > 0.0 else replace(memory, closing_bias_m=bias_m)
