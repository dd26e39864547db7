"""The paper's law: NMPC with a movable speed bound and a breakaway bound from the stiction table (paper §4, §5). Pure.

`paper` uses the table; `paper-plain` is the same controller without it (paper simulations 1 and 2).
"""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

import numpy as np

from positioner.laws.bounds import Bounds
from positioner.laws.law import Decision, Estimate, Observation
from positioner.laws.paper.bounds import breakaway_bounds_ma, speed_bounds_m_per_s
from positioner.laws.paper.estimator import estimate, first_estimate
from positioner.laws.paper.planner import plan
from positioner.laws.pushes import Pushes
from positioner.values import dataclass, replace
from positioner.valve.stick_slip import edge_lessons
from positioner.valve.stiction import Quantity, direction_of
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from positioner.laws.estimator_settings import EstimatorSettings
    from positioner.laws.paper.bounds import BoundSettings
    from positioner.laws.paper.estimator import FilteredStem
    from positioner.laws.paper.planner import PlannerSettings
    from positioner.optimization.qp import Solver
    from positioner.valve.parameters import ValveParameters
    from positioner.valve.state import StemState
    from positioner.valve.stiction import StictionTable


@dataclass(frozen=True, slots=True)
class PaperMemory:
    """What the law carries: the estimate, the plan shifted by one (H_u,), and its failed pushes.

    released: whether the last decision was a push to free the stem.
    """

    stem: FilteredStem
    inputs_ma: NDArray[np.float64]
    released: bool = False
    pushes: Pushes = field(default_factory=Pushes)


@dataclass(frozen=True, slots=True)
class PaperLaw:
    """The paper's controller; `use_table` False is its plain NMPC.

    `table_from_s`: time from which the table is used (paper §6.3: 3 s); the law learns from the beginning.
    """

    name: str
    valve: ValveParameters
    planner: PlannerSettings
    estimator: EstimatorSettings
    bounds: BoundSettings
    solver: Solver
    current_low_ma: float
    current_high_ma: float
    period_s: float
    use_table: bool = True
    table_from_s: float = 0.0

    def begin(self, measured_m: float) -> PaperMemory:
        """Return the memory of a stem at rest where it was measured."""
        start = self._clamp(self.valve.balance_current_ma(measured_m))
        stem = first_estimate(self.estimator, self.valve, measured_m)
        return PaperMemory(stem, np.full(self.planner.control_steps, start))

    def estimate(self, memory: PaperMemory, observation: Observation) -> tuple[PaperMemory, Estimate]:
        """Return the estimated position and speed (D11: by a Kalman filter, or raw if the settings say so)."""
        stem = estimate(
            self.estimator,
            self.valve,
            memory.stem,
            observation.measured_m,
            observation.applied_ma,
            observation.elapsed_s,
        )
        lessons = edge_lessons(memory.stem, stem, observation.applied_ma)
        return replace(memory, stem=stem), Estimate(stem, lessons)

    def decide(
        self, memory: PaperMemory, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[PaperMemory, Decision]:
        """Return the memory, and the first input of the plan within the movable bounds; without one, balance (D12)."""
        pushes = memory.pushes.for_setpoint(observation.setpoint_m, self.valve.span_m)
        if memory.released:
            pushes = pushes.after_push(
                moved=not stem.stuck,
                time_s=observation.time_s,
                rest_m=stem.position_m,
                sigma_m=memory.stem.position_sigma_m,
            )
        memory = replace(memory, pushes=pushes)
        bounds, releasing = self._bounds(memory, stem, observation, table)
        has_failed = memory.released and stem.stuck
        failed_pushes, rest_s = (pushes.failed, pushes.rest_s) if has_failed else (0, 0.0)
        guess = np.clip(memory.inputs_ma, bounds.current_low_ma, bounds.current_high_ma)
        start = (stem.position_m, stem.velocity_m_per_s)
        found = plan(self.planner, self.valve, self.solver, start, observation.setpoint_m, bounds, guess, self.period_s)
        if found is None:
            hold = self._clamp(self.valve.balance_current_ma(stem.position_m))
            memory = replace(memory, inputs_ma=np.full_like(guess, hold), released=releasing)
            why = "no plan within the bounds: spring balanced"
            return memory, Decision(hold, bounds, Motion.REST, fallback=why, failed_pushes=failed_pushes, rest_s=rest_s)
        shifted = np.append(found.inputs_ma[1:], found.inputs_ma[-1])
        motion = Motion.REST if stem.stuck and not releasing else Motion.MOVE
        decision = Decision(
            float(found.inputs_ma[0]),
            bounds,
            motion,
            passes=found.passes,
            failed_pushes=failed_pushes,
            rest_s=rest_s,
        )
        return replace(memory, inputs_ma=shifted, released=releasing), decision

    def _bounds(
        self, memory: PaperMemory, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[Bounds, bool]:
        """Return the bounds of this cycle, and whether they release a stuck stem (eqs 22-26; D8)."""
        low, high = self.current_low_ma, self.current_high_ma
        free = Bounds(-self.bounds.max_speed_m_per_s, self.bounds.max_speed_m_per_s, low, high)
        if not self.use_table or observation.time_s < self.table_from_s:
            return free, False
        error = observation.setpoint_m - stem.position_m
        direction = direction_of(error)
        if stem.stuck and abs(error) > self.bounds.breakaway_tolerance_m:
            cell = table.cell(Quantity.BREAKAWAY_CURRENT, stem.position_m, direction)
            if cell is not None and not memory.released and memory.pushes.may_push(observation.time_s):
                # one sample at Γ; the speed bound would forbid the push that it asks for
                low, high = breakaway_bounds_ma(error, cell.mean, low, high)
                return Bounds(free.speed_low_m_per_s, free.speed_high_m_per_s, low, high), True
        cell = table.cell(Quantity.STICK_SPEED, observation.setpoint_m, direction)
        speeds = speed_bounds_m_per_s(self.bounds, error, cell.mean if cell else None)
        return Bounds(*speeds, low, high), False

    def _clamp(self, current_ma: float) -> float:
        return min(max(current_ma, self.current_low_ma), self.current_high_ma)
