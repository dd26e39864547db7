"""The `[guard]` table of a configuration: limits of the current, ages of the data, what FAILSAFE commands. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable
from positioner.wire.loop_current import LARGEST_MA, VALUE_HIGH_MA, VALUE_LOW_MA, LoopSignal, signal_of


class FailsafeAction(StrEnum):
    """What the current does in FAILSAFE."""

    LOW = "4 mA"
    HIGH = "20 mA"
    KEEP_CURRENT = "hold"
    CURRENT = "current"


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardSettings(SettingsTable):
    """The `[guard]` table of a configuration.

    auto_arm: arm at the first valid feedback, for benches; otherwise the host arms.
    current_low_ma, current_high_ma: what the loop may carry (NAMUR NE 43: 3.8 to 20.5 mA is measurement).
    max_rate_ma_per_s: fastest change of the current; 0 leaves it free.
    feedback_hold_periods, feedback_failsafe_periods: sample periods without valid feedback until HOLD and FAILSAFE.
    setpoint_hold_s, setpoint_failsafe_s: time without a valid setpoint until HOLD and FAILSAFE; 0 means never.
    law_failsafe_cycles: cycles in a row without a usable answer of the law until FAILSAFE; also, late cycles in a row
        until a warning.
    failsafe_action: what FAILSAFE commands: "4 mA", "20 mA", "hold" (the last current) or "current".
    failsafe_current_ma: the current of the action "current"; it may be a failure signal (NE 43: 3.6 mA and below, 21 mA
        and above), to which an actuator reacts by itself.
    actuator_deadman_s: after so long without a command the actuator goes to its fail position by itself; `positioner
        check` compares the sample period with it. 0: the actuator never does so.
    position_margin_m: how far beyond the travel a reading is still plausible; noise reaches beyond a hard stop.
    max_jump_m: largest plausible step between two readings; with a long sample period at least as far as the stem
        moves in one, or the law's own moves are refused.
    frozen_s, frozen_command_ma: a reading that stays the same to the bit for so long (0: no check), while the command
        is so far beyond the stick band, is frozen; an actuator with a lag needs several times its lag.
    deviation_of_span, deviation_s: an error beyond this part of the span (0: no check, nor of a stem that hunts or that
        pushes do not move), while the stem comes no nearer for so long, is reported as a deviation; an actuator with a
        lag needs several times its lag.
    """

    auto_arm: bool = False
    current_low_ma: Annotated[float, Interval(ge=VALUE_LOW_MA, le=VALUE_HIGH_MA)] = 4.0
    current_high_ma: Annotated[float, Interval(ge=VALUE_LOW_MA, le=VALUE_HIGH_MA)] = 20.0
    max_rate_ma_per_s: Annotated[float, Interval(ge=0.0, le=1e6)] = 0.0
    feedback_hold_periods: Annotated[int, Interval(ge=2, le=1000)] = 3
    feedback_failsafe_periods: Annotated[int, Interval(ge=3, le=10000)] = 10
    setpoint_hold_s: Annotated[float, Interval(ge=0.0, le=3600.0)] = 0.5
    setpoint_failsafe_s: Annotated[float, Interval(ge=0.0, le=86400.0)] = 10.0
    law_failsafe_cycles: Annotated[int, Interval(ge=1, le=1000)] = 10
    failsafe_action: FailsafeAction = FailsafeAction.LOW
    failsafe_current_ma: Annotated[float, Interval(ge=0.0, le=LARGEST_MA)] = 4.0
    actuator_deadman_s: Annotated[float, Interval(ge=0.0, le=3600.0)] = 0.1
    position_margin_m: Annotated[float, Interval(ge=0.0, le=0.5)] = 0.02
    max_jump_m: Annotated[float, Interval(gt=0.0, le=2.0)] = 0.05
    frozen_s: Annotated[float, Interval(ge=0.0, le=3600.0)] = 2.0
    frozen_command_ma: Annotated[float, Interval(ge=0.1, le=16.0)] = 1.5
    deviation_of_span: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.05
    deviation_s: Annotated[float, Interval(ge=0.1, le=3600.0)] = 1.5

    def __post_init__(self) -> None:
        """Refuse limits in the wrong order."""
        if self.current_low_ma >= self.current_high_ma:
            raise ValueError("current_low_ma must be below current_high_ma")
        if self.feedback_failsafe_periods <= self.feedback_hold_periods:
            raise ValueError("feedback_failsafe_periods must exceed feedback_hold_periods")
        if 0.0 < self.setpoint_failsafe_s <= self.setpoint_hold_s:
            raise ValueError("setpoint_failsafe_s must exceed setpoint_hold_s, or be 0 for never")
        if signal_of(self.failsafe_current_ma) is LoopSignal.NEITHER:
            raise ValueError("failsafe_current_ma must be a value (3.8 to 20.5) or a failure signal (≤ 3.6 or ≥ 21)")

    def failsafe_ma(self, last_ma: float) -> float:
        """Return the current of FAILSAFE in mA; `last_ma` was commanded before."""
        match self.failsafe_action:
            case FailsafeAction.LOW:
                return 4.0
            case FailsafeAction.HIGH:
                return 20.0
            case FailsafeAction.CURRENT:
                return self.failsafe_current_ma
            case _:  # KEEP_CURRENT
                return last_ma
