"""Every control law by name. A new law is one file and one entry here. Pure, but for the solver it is handed."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from positioner.adaptive_estimate import AdaptiveFilter
from positioner.adaptive_slide import load_of, slider_of
from positioner.laws.nmpc import NmpcLaw
from positioner.laws.paper import PaperLaw

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from positioner.estimate import EstimatorSettings
    from positioner.guard import GuardSettings
    from positioner.laws.law import Law
    from positioner.laws.settings import ControlSettings
    from positioner.model import ValveParameters
    from positioner.planner import Solver


@dataclass(frozen=True, slots=True)
class Ingredients:
    """What a law is made of; `make_solver(variables, constraints)` returns a workspace of that size."""

    control: ControlSettings
    valve: ValveParameters
    estimator: EstimatorSettings
    guard: GuardSettings
    make_solver: Callable[[int, int], Solver]


def _paper(name: str, parts: Ingredients, *, use_table: bool) -> PaperLaw:
    planner = parts.control.planner
    return PaperLaw(
        name=name,
        valve=parts.valve,
        planner=planner,
        estimator=parts.estimator,
        bounds=parts.control.bounds,
        solver=parts.make_solver(planner.control_steps, planner.control_steps + planner.prediction_steps),
        current_low_ma=parts.guard.current_low_ma,
        current_high_ma=parts.guard.current_high_ma,
        period_s=parts.control.sample_period_s,
        use_table=use_table,
        table_from_s=parts.control.table_from_s,
    )


def _nmpc(parts: Ingredients) -> NmpcLaw:
    settings, valve = parts.control.nmpc, parts.valve
    steps = settings.approach
    return NmpcLaw(
        name="nmpc",
        valve=valve,
        settings=settings,
        estimator=parts.estimator,
        filter=AdaptiveFilter(settings.adaptation, slider_of(valve), load_of(valve)),
        solver=parts.make_solver(steps.control_steps, steps.control_steps + steps.prediction_steps),
        current_low_ma=parts.guard.current_low_ma,
        current_high_ma=parts.guard.current_high_ma,
        period_s=parts.control.sample_period_s,
        table_from_s=parts.control.table_from_s,
        table_cell_m=parts.control.table_cell_m,
    )


LAWS: Mapping[str, tuple[str, Callable[[Ingredients], Law[Any]]]] = MappingProxyType(
    {
        "nmpc": (
            "NMPC with an adaptive filter, the movable bound as the exact stopping point, and averaging at rest",
            _nmpc,
        ),
        "paper": (
            "the paper's NMPC with movable speed bound and breakaway bound from the stiction table",
            lambda parts: _paper("paper", parts, use_table=True),
        ),
        "paper-plain": (
            "the paper's NMPC without the table",
            lambda parts: _paper("paper-plain", parts, use_table=False),
        ),
    }
)
"""Name → what it is, and how it is made."""
