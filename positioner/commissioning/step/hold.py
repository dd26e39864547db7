"""No control law at all: each setpoint is a current, 4 mA at 0 and 20 mA at one span, that is held. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.commissioning.step.plan import SIGNAL_LOW_MA, SIGNAL_SPAN_MA
from positioner.laws.bounds import Bounds
from positioner.laws.law import Decision, Estimate
from positioner.values import dataclass
from positioner.valve.state import StemState

if TYPE_CHECKING:
    from positioner.laws.law import Observation
    from positioner.valve.stiction import StictionTable


@dataclass(frozen=True, slots=True)
class HoldLaw:
    """The open loop, as a law without a memory."""

    travel_min_m: float
    span_m: float
    name: str = "hold"

    def begin(self, measured_m: float) -> None:
        """Return nothing: there is no memory."""

    def estimate(self, memory: None, observation: Observation) -> tuple[None, Estimate]:  # noqa: ARG002 - the interface's
        """Return the reading as the estimate."""
        return None, Estimate(StemState(observation.measured_m, 0.0, True, 1.0))

    def decide(
        self,
        memory: None,  # noqa: ARG002 - the interface's
        stem: StemState,  # noqa: ARG002
        observation: Observation,
        table: StictionTable,  # noqa: ARG002
    ) -> tuple[None, Decision]:
        """Return the current of the setpoint, in mA."""
        part = (observation.setpoint_m - self.travel_min_m) / self.span_m
        return None, Decision(SIGNAL_LOW_MA + SIGNAL_SPAN_MA * part, Bounds(0.0, 0.0, 0.0, 0.0))
