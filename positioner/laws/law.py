"""The interface of every control law. Pure.

A law is immutable. What it remembers from cycle to cycle is its memory, which the cycle carries for it. In each cycle
the law answers two questions:

    estimate: where is the stem, how fast, does it stick, and what has this reading taught about the valve?
    decide:   which current next, within which bounds, and why?

Between them, the cycle writes what was taught to the stiction table.
"""

from __future__ import annotations

from dataclasses import KW_ONLY  # noqa: TC003 - read when the class is made
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from positioner.values import dataclass
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from positioner.laws.bounds import Bounds
    from positioner.laws.move_reason import MoveReason
    from positioner.valve.state import StemState
    from positioner.valve.stiction import LearnedSample, StictionTable

M = TypeVar("M")


@dataclass(frozen=True, slots=True)
class Observation:
    """The input of a law in one cycle.

    measured_m: the newest position reading.
    applied_ma: the current that acted on the plant since the reading before.
    elapsed_s: time between the two readings, a whole number of sample periods.
    setpoint_m: the wanted position, inside the travel.
    time_s: time since control began.
    pressure_pa: the measured actuator pressure, None without a sensor.
    pressure_is_new: whether it was measured with this reading, and not before.
    """

    measured_m: float
    applied_ma: float
    elapsed_s: float
    setpoint_m: float
    time_s: float
    pressure_pa: float | None = None
    pressure_is_new: bool = False


@dataclass(frozen=True, slots=True)
class Estimate:
    """What a law makes of a reading: the state of the stem, and what the reading taught, for the stiction table.

    A law that learns only from the edges between sticking and sliding gets these lessons from `valve.stick_slip`.
    """

    stem: StemState
    lessons: tuple[LearnedSample, ...] = ()


@dataclass(frozen=True, slots=True)
class Decision:
    """What a law answers: the current in mA, the bounds that were in force, what it is doing, and why.

    passes: programmes solved for it.
    fallback: why the law could not do what it wanted, else empty.
    reason: why a move begins, None where none begins.
    failed_pushes: pushes in a row that did not free the stem, 0 unless this cycle has found one more; rest_s: for how
        long the law now leaves the stem alone.
    differs: the valve does not move as it is configured: moves have missed where it should have stopped.
    """

    current_ma: float
    bounds: Bounds
    motion: Motion = Motion.NONE
    _: KW_ONLY
    passes: int = 0
    fallback: str = ""
    reason: MoveReason | None = None
    failed_pushes: int = 0
    rest_s: float = 0.0
    differs: bool = False


class Law(Protocol, Generic[M]):
    """A control law with a memory of type M."""

    @property
    def name(self) -> str:
        """The name of the law in a configuration."""

    def begin(self, measured_m: float) -> M:
        """Return the memory of a law that starts at this reading, in m, and knows nothing of the past."""

    def estimate(self, memory: M, observation: Observation) -> tuple[M, Estimate]:
        """Return the memory with this cycle's reading in it, and the estimate."""

    def decide(self, memory: M, stem: StemState, observation: Observation, table: StictionTable) -> tuple[M, Decision]:
        """Return the memory after the decision, and the decision; without a plan, the law's own fallback."""
