"""The interface of every control law. Pure.

A law is immutable; what it remembers from cycle to cycle is its memory, which the cycle carries for it. The cycle asks
it two questions, and between them learns the edges that the first answer shows:

    estimate: where is the stem, how fast, and does it stick?
    decide:   which current next, within which bounds, and why?
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from positioner.laws.bounds import Bounds
    from positioner.valve.state import StemState
    from positioner.valve.stiction import StictionTable

M = TypeVar("M")


@dataclass(frozen=True, slots=True)
class Observation:
    """What a law sees in one cycle.

    measured_m: the newest position reading.
    applied_ma: the current that acted on the plant since the reading before.
    elapsed_s: time between the two readings, a whole number of sample periods.
    setpoint_m: the wanted position, inside the travel.
    time_s: time since control began.
    pressure_pa: the measured actuator pressure, where there is a sensor.
    """

    measured_m: float
    applied_ma: float
    elapsed_s: float
    setpoint_m: float
    time_s: float
    pressure_pa: float | None = None


@dataclass(frozen=True, slots=True)
class Decision:
    """What a law answers: the current in mA, the bounds that were in force, what it is doing, and why.

    `fallback` names the reason where the law could not do what it wanted, else it is empty; `reason` says in words
    why a move begins, and what its first current rests on. `failed_pushes` is not 0 where this cycle has found that a
    push did not free the stem: how many in a row, and `rest_s` for how long the law now leaves the stem alone.
    """

    current_ma: float
    bounds: Bounds
    motion: Motion = Motion.NONE
    passes: int = 0
    fallback: str = ""
    reason: str = ""
    failed_pushes: int = 0
    rest_s: float = 0.0


class Law(Protocol, Generic[M]):
    """A control law with a memory of type M."""

    @property
    def name(self) -> str:
        """The name the law is chosen by."""

    def begin(self, measured_m: float) -> M:
        """Return the memory of a law that sees its first reading, with nothing of the past."""

    def estimate(self, memory: M, observation: Observation) -> tuple[M, StemState]:
        """Return the memory with this cycle's reading in it, and the state of the stem."""

    def decide(self, memory: M, stem: StemState, observation: Observation, table: StictionTable) -> tuple[M, Decision]:
        """Return the memory after the decision, and the decision. Never raises for a plan that does not exist."""
