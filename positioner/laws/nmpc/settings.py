"""The `[control.nmpc]` table of a configuration. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable
from positioner.laws.nmpc.breakaway import BreakawaySettings
from positioner.laws.nmpc.filter import AdaptationSettings
from positioner.laws.nmpc.plan import ApproachSettings
from positioner.laws.nmpc.verification import WatchSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class NmpcSettings(SettingsTable):
    """What the law `nmpc` may be told.

    tolerance_m: error that is not worth a correction, however well it is known.
    doubt_sigma: an error counts only as far as it exceeds so many σ of the average.
    patience: by what part the tolerance grows with every correction of the same setpoint.
    patience_limit: the number of corrections at which it stops growing.
    brake_share: the braking current rests so far from the middle of the stick band of the target, in F_s.
    brake_limit: the strongest braking, in F_c: inside the stick band, or the valve would reverse.
    hold_step_ma: change of the middle of the stick band that the held current follows.
    landing_sigma_m: how well the end of a move must be known to teach the table.
    settle_s: after a stop, until readings count as of a resting stem.
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
    watch: WatchSettings = field(default_factory=WatchSettings)
