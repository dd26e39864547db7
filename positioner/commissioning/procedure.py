"""The interface of a test procedure, and the law that runs one inside `cycle.step`. Pure.

A procedure is a state machine. In each cycle it receives an observation and answers with a current, as a law does; the
guard limits that current as it limits a law's. It ends with recorded data. What the data show is computed afterwards,
by a pure function, when no valve waits for a command.

A procedure that moves the stem to setpoints holds a control law of its own and asks it for the current.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from positioner.laws.bounds import Bounds
from positioner.laws.law import Decision, Estimate, Observation
from positioner.values import dataclass, replace
from positioner.valve.state import StemState
from positioner.wire.messages import Cause, Mode
from positioner.wire.words import in_words

if TYPE_CHECKING:
    from positioner.cycle.state import Setup
    from positioner.guard.settings import GuardSettings
    from positioner.valve.parameters import ValveParameters
    from positioner.valve.stiction import StictionTable

M = TypeVar("M")
TOLERATED = frozenset({Cause.NONE, Cause.LAW_LATE, Cause.PERIOD_WRONG})
"""What the guard may report while a procedure goes on."""
_OF_LOAD = frozenset({Cause.LAW_LATE, Cause.STALLED, Cause.PERIOD_WRONG})
"""What a machine that is too busy leads to by itself."""


@dataclass(frozen=True, slots=True)
class ProcedureLimits:
    """What a procedure may do to a valve: range and rate of the current, and the travel between the stops.

    rate_ma_per_s is infinite where the configuration leaves the rate free.
    """

    current_low_ma: float
    current_high_ma: float
    rate_ma_per_s: float
    travel_min_m: float
    travel_max_m: float
    span_m: float

    @classmethod
    def of(cls, valve: ValveParameters, guard: GuardSettings) -> ProcedureLimits:
        """Return the limits of a configuration."""
        return cls(
            guard.current_low_ma,
            guard.current_high_ma,
            guard.max_rate_ma_per_s or math.inf,
            valve.travel_min_m,
            valve.travel_max_m,
            valve.span_m,
        )


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a procedure is: the part that is done (0 to 1), what it does now, and whether it has ended.

    aborted: why it has no result, empty while it has not been aborted.
    """

    part: float
    doing: str
    ended: bool = False
    aborted: str = ""


class Procedure(Protocol, Generic[M]):
    """A test procedure with a memory of type M."""

    @property
    def name(self) -> str:
        """The name of the procedure in messages."""

    def begin(self, measured_m: float) -> M:
        """Return the memory of a procedure that starts at this reading, in m."""

    def advance(self, memory: M, observation: Observation) -> tuple[M, float]:
        """Return the memory with this cycle's observation in it, and the current in mA that it asks for."""

    def progress(self, memory: M) -> Progress:
        """Return how far the procedure is."""

    def abort(self, memory: M, why: str) -> M:
        """Return the memory of a procedure that is to bring the stem back to its start and then end."""


@dataclass(frozen=True, slots=True)
class ProcedureLaw(Generic[M]):
    """A procedure in the place of a law: it believes every reading, and teaches the stiction table nothing."""

    procedure: Procedure[M]
    limits: ProcedureLimits

    @property
    def name(self) -> str:
        """The name of the procedure."""
        return self.procedure.name

    def begin(self, measured_m: float) -> M:
        """Return the memory of the procedure at its start."""
        return self.procedure.begin(measured_m)

    def estimate(self, memory: M, observation: Observation) -> tuple[M, Estimate]:
        """Return the reading as the estimate."""
        return memory, Estimate(StemState(observation.measured_m, 0.0, True, 1.0))

    def decide(self, memory: M, stem: StemState, observation: Observation, table: StictionTable) -> tuple[M, Decision]:  # noqa: ARG002 - the interface's
        """Return what the procedure asks for."""
        memory, current_ma = self.procedure.advance(memory, observation)
        limits = self.limits
        return memory, Decision(current_ma, Bounds(-math.inf, math.inf, limits.current_low_ma, limits.current_high_ma))


def commissioning_setup(setup: Setup, procedure: Procedure[M]) -> Setup:
    """Return the setup in which `procedure` runs in place of the law: armed at once, without setpoints of a host."""
    guard = replace(setup.guard, auto_arm=True, setpoint_hold_s=0.0, setpoint_failsafe_s=0.0, deviation_of_span=0.0)
    law = procedure_law(procedure, setup.valve, setup.guard)
    return replace(setup, guard=guard, law=law, testing=True, setpoint=None)


def procedure_law(procedure: Procedure[M], valve: ValveParameters, guard: GuardSettings) -> ProcedureLaw[M]:
    """Return the law that `procedure` is, for this valve within these limits."""
    return ProcedureLaw(procedure, ProcedureLimits.of(valve, guard))


def ended_by(mode: Mode, cause: Cause) -> str:
    """Return that the guard has ended a procedure that had begun, and why; empty while it may go on."""
    if mode is Mode.HOLD or (mode is Mode.ACTIVE and cause in TOLERATED):
        return ""
    return f"ended by the guard: {mode.name}, {in_words(cause)}"


def aborted_by(mode: Mode, cause: Cause) -> str:
    """Return why a procedure that may go on is to be aborted; empty where it is not.

    A stall of this process loses some readings, and no more.
    """
    if cause is Cause.PERIOD_WRONG or (mode is Mode.HOLD and cause is not Cause.STALLED):
        return f"the guard reports: {in_words(cause)}"
    return ""


def load_remedy(cause: Cause, late: int, stalls: int) -> str:
    """Return what to do where a busy machine may have ended a procedure; empty where nothing points to it.

    late, stalls: how many late cycles and stalls were counted.
    """
    if not (late or stalls or cause in _OF_LOAD):
        return ""
    counts = ((late, "late cycle"), (stalls, "stall"))
    counted = " and ".join([f"{count} {what}{'s' if count > 1 else ''}" for count, what in counts if count])
    return (
        f"where other programs kept the machine busy ({counted or 'no cycle of the positioner was late'}): start them "
        "with `nice`, or give a longer control.sample_period_s; with an emulator, --clock lockstep for both"
    )
