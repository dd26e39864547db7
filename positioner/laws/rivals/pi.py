"""The law `pi`, alone or with a compensator against stiction. Pure.

`pi-deadband` freezes the current while the error is inside a dead band, so that the integral does not hunt; the laws
`knocker` and `constant-reinforcement` add a current that is to free the stem, see their compensators.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Generic, Protocol, TypeVar

from annotated_types import Interval

from positioner.inputs.table import SettingsTable
from positioner.laws.bounds import Bounds
from positioner.laws.law import Decision
from positioner.laws.rivals.model_free import report
from positioner.laws.rivals.pid import PidSettings  # noqa: TC001 - pydantic reads this hint at run time
from positioner.values import dataclass, replace
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from positioner.laws.law import Estimate, Observation
    from positioner.laws.rivals.pid import PidController, PidMemory
    from positioner.valve.parameters import ValveParameters
    from positioner.valve.state import StemState
    from positioner.valve.stiction import StictionTable

C = TypeVar("C")


@dataclass(frozen=True, slots=True, kw_only=True)
class PiDeadbandSettings(SettingsTable):
    """The `[control.pi_deadband]` table: the controller and its dead band.

    pid: the controller's gains.
    deadband_m: error below which the current is frozen.
    """

    pid: PidSettings
    deadband_m: Annotated[float, Interval(ge=0.0, le=0.1)]


class Compensator(Protocol[C]):
    """Adds a current to the controller's output; its memory is a C."""

    def begin(self, output_ma: float) -> C:
        """Return the memory before the first cycle, the controller's output being `output_ma`."""

    def add(self, memory: C, output_ma: float, error_m: float, elapsed_s: float) -> tuple[C, float]:
        """Return the memory and the current in mA to add to the controller's output, `elapsed_s` after the last."""


@dataclass(frozen=True, slots=True)
class NoCompensator:
    """Adds nothing: the plain controller."""

    def begin(self, output_ma: float) -> None:
        """Return nothing to remember."""

    def add(self, memory: None, output_ma: float, error_m: float, elapsed_s: float) -> tuple[None, float]:  # noqa: ARG002 - the interface's
        """Return no memory and no current."""
        return None, 0.0


@dataclass(frozen=True, slots=True)
class PiMemory(Generic[C]):
    """What the law carries: the controller's memory, the compensator's, and the current commanded last."""

    pid: PidMemory
    compensator: C
    current_ma: float


@dataclass(frozen=True, slots=True)
class PiLaw(Generic[C]):
    """The law; `deadband_m` is 0 for a law without a dead band."""

    name: str
    valve: ValveParameters
    controller: PidController
    compensator: Compensator[C]
    deadband_m: float = 0.0

    def begin(self, measured_m: float) -> PiMemory[C]:
        """Return the memory of a stem at rest, with the integral in the middle of its stick band."""
        pid = self.controller.begin(measured_m, self.valve.balance_current_ma(measured_m))
        return PiMemory(pid, self.compensator.begin(pid.integral_ma), pid.integral_ma)

    def estimate(self, memory: PiMemory[C], observation: Observation) -> tuple[PiMemory[C], Estimate]:
        """Return the memory with the reading in the filter, and the filtered position."""
        pid = self.controller.see(memory.pid, observation.measured_m, observation.elapsed_s)
        return replace(memory, pid=pid), report(pid.position_m, pid.speed_m_per_s)

    def decide(
        self, memory: PiMemory[C], stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[PiMemory[C], Decision]:
        """Return the memory, and the output plus compensation within the loop's limits; the table is not used."""
        del table
        low_ma, high_ma = self.controller.current_low_ma, self.controller.current_high_ma
        bounds = Bounds(-math.inf, math.inf, low_ma, high_ma)
        error_m = observation.setpoint_m - stem.position_m
        if abs(error_m) < self.deadband_m:
            return memory, Decision(memory.current_ma, bounds, Motion.REST)
        pid, output_ma = self.controller.output(memory.pid, observation.setpoint_m, observation.elapsed_s)
        carried, added_ma = self.compensator.add(memory.compensator, output_ma, error_m, observation.elapsed_s)
        current_ma = min(max(output_ma + added_ma, low_ma), high_ma)
        return PiMemory(pid, carried, current_ma), Decision(current_ma, bounds)
