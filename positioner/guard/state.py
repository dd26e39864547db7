"""What the guard is given in a cycle, and what it remembers between two. Pure."""

from __future__ import annotations

from dataclasses import field

from positioner.guard.manual import AUTOMATIC, Manual
from positioner.values import dataclass, replace
from positioner.wire.messages import Cause, Health, HostRequest, ManualCurrent, Mode

# tuples, which are searched by identity: a set would compute the hash of a mode by its name
CONTROLLING = (Mode.ACTIVE, Mode.HOLD)
"""The modes in which the law's answer counts."""
_SENDING = (*CONTROLLING, Mode.FAILSAFE, Mode.MANUAL)
_OF_MOTION = frozenset({Cause.DEVIATION, Cause.SETPOINT_UNREACHABLE, Cause.HUNTING, Cause.NO_MOTION})
_OUT_OF_SPECIFICATION = _OF_MOTION | {Cause.LAW_LATE, Cause.PERIOD_WRONG, Cause.VALVE_DIFFERS}


@dataclass(frozen=True, slots=True)
class GuardInput:
    """What the frames of this cycle brought.

    feedback_age_ns: how long ago the newest plausible reading arrived, None where none did; feedback_refused: why a
        reading was not plausible. setpoint_age_ns, setpoint_refused: the same of a usable setpoint.
    requests: of the host, in their order, repetitions left out; waiting_request: the last one that was too old
        to arm; stray_disarm: a DISARM came in a frame out of sequence; manual: the newest MANUAL_CURRENT.
    foreign_command: another controller's command; own_command_returned: a command like one of ours.
    """

    feedback_age_ns: int | None = None
    feedback_refused: Cause | None = None
    setpoint_age_ns: int | None = None
    setpoint_refused: Cause | None = None
    requests: tuple[HostRequest, ...] = ()
    waiting_request: HostRequest | None = None
    stray_disarm: bool = False
    manual: ManualCurrent | None = None
    foreign_command: bool = False
    own_command_returned: bool = False


@dataclass(frozen=True, slots=True)
class Conditions:
    """What is wrong besides missing data; by default, nothing.

    stall_ns: how long the process stood still just before, 0 for no stall; late: the cycle before took longer than a
        period; answered: the law had answered in it.
    no_effect: why commands do not act on the valve; deviation: DEVIATION or SETPOINT_UNREACHABLE, where the error does
        not shrink; hunting: the stem swings without an end; no_motion: pushes move neither it nor its reading.
    period_wrong: position frames come at another period than the configured one.
    valve_differs: the law says that the valve does not move as it is configured.
    testing: a test procedure is in the place of the law.
    """

    stall_ns: int = 0
    late: bool = False
    answered: bool = False
    no_effect: Cause | None = None
    deviation: Cause = Cause.NONE
    hunting: bool = False
    no_motion: bool = False
    period_wrong: bool = False
    valve_differs: bool = False
    testing: bool = False


NOTHING_WRONG = Conditions()


@dataclass(frozen=True, slots=True)
class Arming:
    """Whether the positioner is armed, and what decides it.

    request: the host's request in force; None before the first one, when an ARM does not count yet.
    armed_or_returned_ns: the last arming, or when a command like one of ours last came back.
    """

    armed: bool = False
    ever_armed: bool = False
    request: HostRequest | None = None
    armed_or_returned_ns: int = 0


@dataclass(frozen=True, slots=True)
class LastReceived:
    """Monotonic instants, None for never; no_feedback, no_setpoint: the cause to report where they are too old."""

    feedback_ns: int | None = None
    setpoint_ns: int | None = None
    foreign_ns: int | None = None
    no_feedback: Cause = Cause.FEEDBACK_STALE
    no_setpoint: Cause = Cause.SETPOINT_STALE


@dataclass(frozen=True, slots=True)
class LawRecord:
    """Numbers of cycles in a row: without an answer of the law; longer than a period; whose answer was too late."""

    failures: int = 0
    late_cycles: int = 0
    late_answers: int = 0


@dataclass(frozen=True, slots=True)
class GuardState:
    """Mode and cause, and what decides them."""

    mode: Mode = Mode.INIT
    cause: Cause = Cause.WAITING_FOR_FEEDBACK
    arming: Arming = field(default_factory=Arming)
    last: LastReceived = field(default_factory=LastReceived)
    law: LawRecord = field(default_factory=LawRecord)
    manual: Manual = AUTOMATIC
    conditions: Conditions = NOTHING_WRONG

    @property
    def transmits(self) -> bool:
        """Whether commands may be sent."""
        return self.mode in _SENDING

    @property
    def controls(self) -> bool:
        """Whether the law's answer counts."""
        return self.mode in CONTROLLING

    @property
    def manual_ma(self) -> float | None:
        """The current that a person gives in mA; None in every mode but MANUAL."""
        return self.manual.current_ma if self.mode is Mode.MANUAL else None

    def acts_again(self, before: GuardState) -> bool:
        """Whether our commands alone act on the valve now, and did not `before`."""
        was_without_effect, was_foreign = before.conditions.no_effect is not None, before.last.foreign_ns is not None
        has_effect, is_ours = self.conditions.no_effect is None, self.last.foreign_ns is None
        return (was_without_effect and has_effect) or (was_foreign and is_ours)

    def after_law(self, *, answered: bool) -> GuardState:
        """Return the state after the law answered, or failed to."""
        failures = 0 if answered else self.law.failures + 1
        return self if failures == self.law.failures else replace(self, law=replace(self.law, failures=failures))

    def health(self, *, table_saved: bool) -> Health:
        """Return the NAMUR NE 107 status signal."""
        if self.mode is Mode.FAILSAFE or self.last.foreign_ns is not None:
            return Health.FAILURE
        if self.conditions.testing or self.mode in {Mode.INIT, Mode.READY, Mode.MANUAL}:
            return Health.FUNCTION_CHECK
        if self.conditions.no_effect is not None:
            return Health.FAILURE
        if self.mode is Mode.HOLD or self.cause in _OUT_OF_SPECIFICATION:
            return Health.OUT_OF_SPECIFICATION
        return Health.GOOD if table_saved else Health.MAINTENANCE_REQUIRED
