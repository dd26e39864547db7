"""The `[control.nmpc]` table of a configuration. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable
from positioner.laws.nmpc.breakaway import BreakawaySettings
from positioner.laws.nmpc.filter import AdaptationSettings
from positioner.laws.nmpc.plan import ApproachSettings
from positioner.laws.nmpc.verification import VerificationSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class NmpcSettings(SettingsTable):
    """Settings of the law `nmpc`.

    tolerance_m: error that is not worth a correction, however certain it is.
    doubt_sigma: the law corrects an error once it exceeds the tolerance by so many σ of the average.
    patience: growth of the tolerance with every correction of the same setpoint, as a part of it.
    patience_limit: the number of corrections at which the tolerance stops growing.
    brake_share: distance of the braking current from the middle of the target's stick band, as a part of F_s.
    brake_limit: the strongest braking, as a part of F_c: inside the stick band, or the valve would reverse.
    hold_step_ma: the current at rest follows the middle of the stick band when it is this far away.
    landing_sigma_m: σ of the average below which the end of a move may teach the table.
    settle_s: time after a stop until the stem counts as resting.
    """

    tolerance_m: Annotated[float, Interval(ge=1e-6, le=0.05)] = 5e-5
    doubt_sigma: Annotated[float, Interval(ge=0.0, le=20.0)] = 3.5
    patience: Annotated[float, Interval(ge=0.0, le=10.0)] = 0.15
    patience_limit: Annotated[int, Interval(ge=0, le=1000)] = 10
    brake_share: Annotated[float, Interval(ge=0.0, lt=1.0)] = 0.25
    brake_limit: Annotated[float, Interval(ge=0.0, lt=1.0)] = 0.8
    hold_step_ma: Annotated[float, Interval(ge=0.0, le=16.0)] = 0.4
    settle_s: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.003
    landing_sigma_m: Annotated[float, Interval(gt=0.0, le=0.05)] = 1.5e-4
    approach: ApproachSettings = field(default_factory=ApproachSettings)
    adaptation: AdaptationSettings = field(default_factory=AdaptationSettings)
    breakaway: BreakawaySettings = field(default_factory=BreakawaySettings)
    watch: VerificationSettings = field(default_factory=VerificationSettings)
