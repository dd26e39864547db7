"""What the guard sees in a cycle, and what it remembers between two. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from positioner.guard.manual import AUTOMATIC, Manual
from positioner.wire.messages import Cause, Health, HostRequest, ManualCurrent, Mode

_OUT_OF_SPECIFICATION = frozenset({Cause.LAW_LATE, Cause.PERIOD_WRONG, Cause.DEVIATION, Cause.SETPOINT_UNREACHABLE})


@dataclass(frozen=True, slots=True)
class GuardInput:
    """What this cycle saw: a reading that can be true, a usable setpoint, what the host asks, a foreign command.

    feedback_age_ns, setpoint_age_ns: how long ago they arrived; requests: in their order, a repeated one once; waited:
    the last request that waited for too long to arm; refused: why a reading could not be true; late: the turn before
    took longer than a period; stall_ns: so long that it is a stall; answered: a law had answered in the turn before;
    period_wrong: position frames come at another period than the configured one; own_command_returned: a
    command like one of ours came back.
    stray_disarm: a DISARM in a frame out of sequence; setpoint_refused: why a setpoint was not used.
    manual: what the host last said of manual mode; idle: why commands do not act, None while they do.
    deviation: what the error is called that does not shrink, NONE where there is none.
    """

    feedback: bool = False
    setpoint: bool = False
    requests: tuple[HostRequest, ...] = ()
    foreign_command: bool = False
    refused: Cause | None = None
    late: bool = False
    manual: ManualCurrent | None = None
    stray_disarm: bool = False
    setpoint_refused: Cause | None = None
    feedback_age_ns: int = 0
    setpoint_age_ns: int = 0
    waited: HostRequest | None = None
    stall_ns: int = 0
    answered: bool = False
    idle: Cause | None = None
    deviation: Cause = Cause.NONE
    period_wrong: bool = False
    own_command_returned: bool = False


@dataclass(frozen=True, slots=True)
class GuardState:
    """Mode and cause, and what decides them; instants are monotonic, None for never.

    armed_or_returned_ns: the last arming, or when a command of ours last came back; late_cycles, late_answers: in a
    row; stall_ns:
    how long the process stood still just before, 0 for no stall.
    """

    mode: Mode = Mode.INIT
    cause: Cause = Cause.WAITING_FOR_FEEDBACK
    armed: bool = False
    ever_armed: bool = False
    request: HostRequest | None = None  # in force; none since the start: an ARM does not count yet
    feedback_ns: int | None = None
    setpoint_ns: int | None = None
    foreign_ns: int | None = None
    law_failures: int = 0
    no_feedback: Cause = Cause.FEEDBACK_STALE  # what it is called when feedback is missing
    late_cycles: int = 0
    manual: Manual = AUTOMATIC
    no_setpoint: Cause = Cause.SETPOINT_STALE  # what it is called when setpoints are missing
    stall_ns: int = 0
    late_answers: int = 0
    idle: Cause | None = None  # why commands do not act
    deviation: Cause = Cause.NONE
    armed_or_returned_ns: int = 0
    period_wrong: bool = False

    @property
    def transmits(self) -> bool:
        """Whether commands may leave."""
        return self.mode in {Mode.ACTIVE, Mode.HOLD, Mode.FAILSAFE, Mode.MANUAL}

    @property
    def controls(self) -> bool:
        """Whether the law's answer counts."""
        return self.mode in {Mode.ACTIVE, Mode.HOLD}

    @property
    def manual_ma(self) -> float | None:
        """The current that a person gives in mA, None but in manual mode."""
        return self.manual.current_ma if self.mode is Mode.MANUAL else None

    def acts_again(self, before: GuardState) -> bool:
        """Whether our commands act on the valve now, and ours alone, which they did not `before`."""
        idle, foreign = before.idle is not None, before.foreign_ns is not None
        return (idle and self.idle is None) or (foreign and self.foreign_ns is None)

    def health(self, *, table_saved: bool) -> Health:
        """Return the NAMUR NE 107 status signal."""
        if self.mode is Mode.FAILSAFE or self.foreign_ns is not None:
            return Health.FAILURE
        if self.mode in {Mode.INIT, Mode.READY, Mode.MANUAL}:
            return Health.FUNCTION_CHECK
        if self.idle is not None:
            return Health.FAILURE
        if self.mode is Mode.HOLD or self.cause in _OUT_OF_SPECIFICATION:
            return Health.OUT_OF_SPECIFICATION
        return Health.GOOD if table_saved else Health.MAINTENANCE_REQUIRED
