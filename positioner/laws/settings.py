"""The `[control]` table of a configuration. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

from annotated_types import Interval

from positioner.bounds import BoundSettings
from positioner.laws.nmpc_settings import NmpcSettings
from positioner.planner import PlannerSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlSettings:
    """What every law may be told.

    law: the control law, by name.
    sample_period_s: T_s, the period of the position frames.
    table_from_s: time since control began from which the stiction table is used (paper §6.3); it always learns.
    table_cell_m: width of a cell of the stiction table.
    planner, bounds: the paper's controller (Table 5, eqs 21-26).
    nmpc: the law of that name.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "allow_inf_nan": False}

    law: str = "paper"
    sample_period_s: Annotated[float, Interval(ge=1e-5, le=1.0)] = 0.001
    table_from_s: Annotated[float, Interval(ge=0.0, le=1e9)] = 0.0
    table_cell_m: Annotated[float, Interval(ge=1e-5, le=0.1)] = 0.005
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    bounds: BoundSettings = field(default_factory=BoundSettings)
    nmpc: NmpcSettings = field(default_factory=NmpcSettings)
