"""A control law inside a procedure: the procedure asks for setpoints, the law answers with currents. Pure.

The law begins anew and with an empty stiction table, and what it learns stays in the procedure. So a test begins under
the same conditions each time, its record alone gives the same commands again, and the valve's own table is untouched.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.values import dataclass, replace
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from positioner.laws.law import Law, Observation
    from positioner.valve.credible import Limits


@dataclass(frozen=True, slots=True)
class LoopState:
    """What the law carries on: its memory, what it has learned in this procedure, and the actuator it has found."""

    memory: Any
    table: StictionTable
    is_first: bool = True


@dataclass(frozen=True, slots=True)
class ClosedLoop:
    """A law, and the range of values that it may learn."""

    law: Law[Any]
    limits: Limits
    cell_width_m: float

    def begin(self, measured_m: float) -> LoopState:
        """Return the state of a law that begins at a reading in m."""
        return LoopState(self.law.begin(measured_m), StictionTable(cell_width_m=self.cell_width_m))

    def current_ma(self, state: LoopState, observation: Observation, setpoint_m: float) -> tuple[LoopState, float]:
        """Return the state after an observation, and the current in mA with which the law pursues the setpoint."""
        observation = replace(observation, setpoint_m=setpoint_m)
        memory, estimate = self.law.estimate(state.memory, observation)
        table = state.table
        for sample in () if state.is_first else estimate.lessons:
            if self.limits.allows(sample, table.cell_width_m / 2.0):
                table = table.learned(sample)
        memory, decision = self.law.decide(memory, estimate.stem, observation, table)
        return LoopState(memory, table, is_first=False), decision.current_ma
