"""The `[control]` table of a configuration. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any

from annotated_types import Interval

from positioner.inputs.table import SettingsTable
from positioner.laws.paper.bounds import BoundSettings
from positioner.laws.paper.planner import PlannerSettings
from positioner.laws.rivals.knocker import KnockerSettings
from positioner.laws.rivals.pi import PiDeadbandSettings
from positioner.laws.rivals.pid import PidSettings
from positioner.laws.rivals.reinforcement import ReinforcementSettings
from positioner.laws.rivals.two_move import TwoMoveRetrySettings, TwoMoveSettings
from positioner.laws.tuned import tuned


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlSettings(SettingsTable):
    """Settings of every law.

    law: the name of the control law; FILE.py:NAME is one in a file, beside the configuration if it is relative.
    shadow: the name of another law, which sees the same valve and sends nothing; log and metrics say where they differ.
    sample_period_s: T_s, the period of the position frames.
    command_delay_s: time from a reading to the instant at which its command acts on the valve, up to a period.
    table_from_s: time since control began from which the stiction table is used (paper §6.3); the law always learns.
    table_cell_m: width of a cell of the stiction table.
    planner, bounds: the paper's controller (Table 5, eqs 21-26).
    nmpc: settings of an older version, which have no effect; of `nmpc`, nothing need be set.
    parameters: numbers by name for a law from outside, which gets them when it is made.
    pi, pi_deadband, knocker, constant_reinforcement, two_move, two_move_retry: the laws of those names; the packaged
        values are results of `positioner tune`. The parameters of one law belong together, so a table must give all of
        them.
    """

    law: str = "nmpc"
    shadow: str | None = None
    sample_period_s: Annotated[float, Interval(ge=1e-5, le=1.0)] = 0.001
    command_delay_s: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.0
    table_from_s: Annotated[float, Interval(ge=0.0, le=1e9)] = 0.0
    table_cell_m: Annotated[float, Interval(ge=1e-5, le=0.1)] = 0.005
    parameters: dict[str, float] = field(default_factory=dict, hash=False)
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    bounds: BoundSettings = field(default_factory=BoundSettings)
    nmpc: dict[str, Any] = field(default_factory=dict, hash=False)
    pi: PidSettings = field(default_factory=partial(tuned, "pi", PidSettings))
    pi_deadband: PiDeadbandSettings = field(default_factory=partial(tuned, "pi-deadband", PiDeadbandSettings))
    knocker: KnockerSettings = field(default_factory=partial(tuned, "knocker", KnockerSettings))
    constant_reinforcement: ReinforcementSettings = field(
        default_factory=partial(tuned, "constant-reinforcement", ReinforcementSettings)
    )
    two_move: TwoMoveSettings = field(default_factory=partial(tuned, "two-move", TwoMoveSettings))
    two_move_retry: TwoMoveRetrySettings = field(default_factory=partial(tuned, "two-move-retry", TwoMoveRetrySettings))

    def __post_init__(self) -> None:
        """Refuse a delay of more than a period."""
        if self.command_delay_s > self.sample_period_s:
            raise ValueError("command_delay_s exceeds sample_period_s")
