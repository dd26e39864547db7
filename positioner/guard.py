"""The guard: modes, arming, stale data, and the last word on the current. Pure.

    INIT -> READY -> ACTIVE <-> HOLD -> FAILSAFE (latched until it is armed again)

The guard knows nothing of the law but its number: whatever it is, what leaves is inside the loop's limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Annotated, ClassVar

from annotated_types import Interval

from positioner.wire.loop_current import LARGEST_MA, VALUE_HIGH_MA, VALUE_LOW_MA, LoopSignal, signal_of
from positioner.wire.messages import Cause, Health, HostRequest, Mode

_NS = 1_000_000_000


class FailsafeAction(StrEnum):
    """What the current does in FAILSAFE."""

    LOW = "4 mA"
    HIGH = "20 mA"
    HOLD = "hold"
    CURRENT = "current"


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardSettings:
    """The `[guard]` table of a configuration.

    auto_arm: arm at the first valid feedback, for benches; otherwise the host arms.
    current_low_ma, current_high_ma: what the loop may carry (NAMUR NE 43: 3.8 to 20.5 mA is measurement).
    max_rate_ma_per_s: 0 leaves the rate free.
    feedback_hold_periods, feedback_failsafe_periods: sample periods without valid feedback until HOLD and FAILSAFE.
    setpoint_hold_s, setpoint_failsafe_s: time without a valid setpoint until HOLD and FAILSAFE; 0 means never.
    law_failsafe_cycles: cycles in a row without a usable answer of the law until FAILSAFE, or late until it is told.
    failsafe_action, failsafe_current_ma: what FAILSAFE commands; the current counts with action "current" only, and
        may be a failure signal (NE 43: 3.6 mA and below, 21 mA and above), which an actuator answers by itself.
    position_margin_m: how far beyond the travel a reading is still plausible; noise reaches beyond a hard stop.
    max_jump_m: largest plausible step between two readings.
    frozen_s, frozen_command_ma: a reading that stays the same to the bit for so long (0: never looked at), while the
        command is so far beyond the stick band, is frozen; an actuator with a lag needs several times its lag.
    """

    __pydantic_config__: ClassVar = {"extra": "forbid", "allow_inf_nan": False}

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
    position_margin_m: Annotated[float, Interval(ge=0.0, le=0.5)] = 0.02
    max_jump_m: Annotated[float, Interval(gt=0.0, le=2.0)] = 0.05
    frozen_s: Annotated[float, Interval(ge=0.0, le=3600.0)] = 2.0
    frozen_command_ma: Annotated[float, Interval(ge=0.1, le=16.0)] = 1.5

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
            case _:  # HOLD
                return last_ma


@dataclass(frozen=True, slots=True)
class Sighting:
    """What this cycle saw: a reading that can be true, a usable setpoint, the host's request, a foreign command.

    refused: why a reading could not be true; late: the cycle before took longer than a period.
    """

    feedback: bool = False
    setpoint: bool = False
    request: HostRequest | None = None
    foreign_command: bool = False
    refused: Cause | None = None
    late: bool = False


@dataclass(frozen=True, slots=True)
class GuardState:
    """Mode and cause, and what decides them; instants are monotonic, None for never; late cycles count in a row."""

    mode: Mode = Mode.INIT
    cause: Cause = Cause.WAITING_FOR_FEEDBACK
    armed: bool = False
    ever_armed: bool = False
    request: HostRequest = HostRequest.NONE
    feedback_ns: int | None = None
    setpoint_ns: int | None = None
    foreign_ns: int | None = None
    law_failures: int = 0
    no_feedback: Cause = Cause.FEEDBACK_STALE  # what it is called when feedback is missing
    late_cycles: int = 0

    @property
    def transmits(self) -> bool:
        """Whether commands may leave."""
        return self.mode in {Mode.ACTIVE, Mode.HOLD, Mode.FAILSAFE}

    @property
    def controls(self) -> bool:
        """Whether the law's answer counts."""
        return self.mode in {Mode.ACTIVE, Mode.HOLD}

    def health(self, *, table_saved: bool) -> Health:
        """Return the NAMUR NE 107 status signal."""
        if self.mode is Mode.FAILSAFE or self.foreign_ns is not None:
            return Health.FAILURE
        if self.mode in {Mode.INIT, Mode.READY}:
            return Health.FUNCTION_CHECK
        if self.mode is Mode.HOLD or self.cause is Cause.LAW_LATE:
            return Health.OUT_OF_SPECIFICATION
        return Health.GOOD if table_saved else Health.MAINTENANCE_REQUIRED


_FOREIGN_MEMORY_NS = _NS
"""A foreign command is held against arming, and kept in the status, for one second."""


def supervise(settings: GuardSettings, state: GuardState, seen: Sighting, period_s: float, now_ns: int) -> GuardState:
    """Return the guard's state after what was `seen`, at `now_ns`."""
    foreign_ns = now_ns if seen.foreign_command else state.foreign_ns
    if foreign_ns is not None and now_ns - foreign_ns > _FOREIGN_MEMORY_NS:
        foreign_ns = None
    state = GuardState(
        state.mode,
        state.cause,
        state.armed,
        state.ever_armed,
        state.request,
        now_ns if seen.feedback else state.feedback_ns,
        now_ns if seen.setpoint else state.setpoint_ns,
        foreign_ns,
        state.law_failures,
        Cause.FEEDBACK_STALE if seen.feedback else seen.refused or state.no_feedback,
        state.late_cycles + 1 if seen.late else 0,
    )
    state = _arm(settings, state, seen, settings.feedback_hold_periods * period_s * _NS, now_ns)
    mode, cause = _mode(settings, state, period_s, now_ns)
    return replace(state, mode=mode, cause=cause)


def _arm(settings: GuardSettings, state: GuardState, seen: Sighting, hold_ns: float, now_ns: int) -> GuardState:
    """Apply a request of the host, which counts when it changes, and the automatic arming, which happens once."""
    asked = seen.request if seen.request is not state.request else None
    fresh = state.feedback_ns is not None and now_ns - state.feedback_ns <= hold_ns
    if asked is not None and (fresh or asked is not HostRequest.ARM):
        # an ARM that comes before the feedback is not used up: its repetition will be heard
        state = replace(state, request=asked)
    if asked is HostRequest.DISARM:
        return replace(
            state,
            armed=False,
            mode=Mode.READY,  # pragma: no mutate - anything but FAILSAFE: the table decides
        )
    wanted = asked is HostRequest.ARM or (settings.auto_arm and not state.ever_armed)
    if not wanted or not fresh or state.foreign_ns is not None:
        return state
    if state.armed and state.mode is not Mode.FAILSAFE:
        return state
    # arming starts the setpoint's age anew: the host has this long to send one
    return replace(
        state,
        armed=True,
        ever_armed=True,
        mode=Mode.HOLD,  # pragma: no mutate - anything but FAILSAFE: the table decides
        setpoint_ns=now_ns,
        law_failures=0,
    )


def _mode(settings: GuardSettings, state: GuardState, period_s: float, now_ns: int) -> tuple[Mode, Cause]:
    """Return the first mode and cause whose condition holds: the transition table of DESIGN.md, from the top."""
    if state.feedback_ns is None:
        return Mode.INIT, Cause.WAITING_FOR_FEEDBACK
    silent_periods = (now_ns - state.feedback_ns) / (period_s * _NS)
    silent_s = math.inf if state.setpoint_ns is None else (now_ns - state.setpoint_ns) / _NS
    foreign = state.foreign_ns is not None
    dead = silent_periods > settings.feedback_failsafe_periods
    rules = (
        (state.mode is Mode.FAILSAFE, Mode.FAILSAFE, state.cause),
        (not state.armed and dead, Mode.INIT, Cause.WAITING_FOR_FEEDBACK),
        (not state.armed and foreign, Mode.READY, Cause.FOREIGN_COMMAND),
        (not state.armed and state.ever_armed, Mode.READY, Cause.DISARMED),
        (not state.armed, Mode.READY, Cause.WAITING_FOR_ARM),
        (dead, Mode.FAILSAFE, state.no_feedback),
        (state.law_failures >= settings.law_failsafe_cycles, Mode.FAILSAFE, Cause.LAW_FAILED),
        (0.0 < settings.setpoint_failsafe_s < silent_s, Mode.FAILSAFE, Cause.SETPOINT_STALE),
        (silent_periods > settings.feedback_hold_periods, Mode.HOLD, state.no_feedback),
        (0.0 < settings.setpoint_hold_s < silent_s, Mode.HOLD, Cause.SETPOINT_STALE),
        (foreign, Mode.ACTIVE, Cause.FOREIGN_COMMAND),
        (state.late_cycles >= settings.law_failsafe_cycles, Mode.ACTIVE, Cause.LAW_LATE),
    )
    return next(((mode, cause) for holds, mode, cause in rules if holds), (Mode.ACTIVE, Cause.NONE))


def is_feedback_stale(settings: GuardSettings, state: GuardState, period_s: float, now_ns: int) -> bool:
    """Return whether the last valid feedback is older than HOLD tolerates."""
    if state.feedback_ns is None:
        return False
    return now_ns - state.feedback_ns > settings.feedback_hold_periods * period_s * _NS


def admit(
    settings: GuardSettings, state: GuardState, wanted_ma: float | None, last_ma: float, elapsed_s: float
) -> float | None:
    """Return the current that may leave, in mA, or None for silence.

    wanted_ma is the law's answer, None where it has none; last_ma was commanded `elapsed_s` before. Whatever the law
    says, the result lies within the limits and, where there is one, within the rate.
    """
    if not state.transmits:
        return None
    if state.mode is Mode.FAILSAFE:
        return settings.failsafe_ma(min(max(last_ma, settings.current_low_ma), settings.current_high_ma))
    current = last_ma if wanted_ma is None or not math.isfinite(wanted_ma) else wanted_ma
    if settings.max_rate_ma_per_s > 0.0:
        step = settings.max_rate_ma_per_s * elapsed_s
        current = min(max(current, last_ma - step), last_ma + step)
    return min(max(current, settings.current_low_ma), settings.current_high_ma)
