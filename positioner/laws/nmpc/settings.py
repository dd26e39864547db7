"""The `[control.nmpc]` table of a configuration, and the tables in it. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

from annotated_types import Interval

from positioner.inputs.table import SettingsTable


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachSettings(SettingsTable):
    """The `[control.nmpc.approach]` table of a configuration.

    prediction_steps, control_steps: H_p, H_u, the horizons in sample periods.
    terminal_factor: weight of the last predicted error, relative to the others.
    input_weight: weight of a current away from the braking current, relative to that of the error it makes.
    max_passes, pass_tolerance_ma: the passes end when the linear model errs by less, as the current that moves a
        stopping point so far; so the bound holds at every step.
    """

    prediction_steps: Annotated[int, Interval(ge=1, le=100)] = 4
    control_steps: Annotated[int, Interval(ge=1, le=100)] = 4
    terminal_factor: Annotated[float, Interval(ge=0.0, le=1e3)] = 3.0
    input_weight: Annotated[float, Interval(gt=0.0, le=1e3)] = 0.03
    max_passes: Annotated[int, Interval(ge=1, le=50)] = 6
    pass_tolerance_ma: Annotated[float, Interval(gt=0.0, le=1.0)] = 1e-3

    def __post_init__(self) -> None:
        """Refuse a control horizon beyond the prediction."""
        if self.control_steps > self.prediction_steps:
            raise ValueError("control_steps exceeds prediction_steps")


@dataclass(frozen=True, slots=True, kw_only=True)
class AdaptationSettings(SettingsTable):
    """The `[control.nmpc.adaptation]` table of a configuration; fractions are of the nominal K_m, F_c and F_v.

    spring_sigma, friction_sigma, viscous_sigma: standard deviations of the configured values.
    friction_per_move, friction_per_m: how much F_c changes from move to move, and per metre.
    force_noise_n: force that the model does not know while sliding; it changes every millisecond.
    landing_noise_m: error of a landing that none of the states explains.
    least, most: limits of the estimates.
    """

    spring_sigma: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.12
    friction_sigma: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.12
    viscous_sigma: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.12
    friction_per_move: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.02
    friction_per_m: Annotated[float, Interval(ge=0.0, le=100.0)] = 0.1
    force_noise_n: Annotated[float, Interval(ge=0.0, le=1e5)] = 30.0
    landing_noise_m: Annotated[float, Interval(ge=0.0, le=0.01)] = 2e-4
    least: Annotated[float, Interval(gt=0.0, le=1.0)] = 0.6
    most: Annotated[float, Interval(ge=1.0, le=10.0)] = 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class BreakawaySettings(SettingsTable):
    """The `[control.nmpc.breakaway]` table of a configuration; forces as fractions of F_s.

    margin: how far a push goes beyond F_s.
    least_count, largest_age, largest_spread: a cell is not used if it has fewer samples, if its newest one is older (in
        learned samples), or if its samples spread more.
    """

    margin: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.02
    least_count: Annotated[int, Interval(ge=1, le=1000)] = 3
    largest_age: Annotated[int, Interval(ge=1, le=1_000_000)] = 500
    largest_spread: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.06


@dataclass(frozen=True, slots=True, kw_only=True)
class VerificationSettings(SettingsTable):
    """The `[control.nmpc.watch]` table of a configuration.

    verdict: log likelihood ratio that decides whether a move has happened.
    ratio_rise, ratio_fall: relative change of F_s/F_c after a push that failed, and after one of no more than Γ that
        freed the stem.
    ratio_most: how far F_s/F_c may rise.
    surprise_sigma, surprise_weight: smoothed innovation, in its own σ, above which a resting stem must have moved, and
        the weight of the newest innovation in it.
    """

    verdict: Annotated[float, Interval(gt=0.0, le=100.0)] = 5.0
    ratio_rise: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.03
    ratio_fall: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.003
    ratio_most: Annotated[float, Interval(ge=1.0, le=100.0)] = 2.0
    surprise_sigma: Annotated[float, Interval(ge=3.0, le=20.0)] = 5.0
    surprise_weight: Annotated[float, Interval(gt=0.0, le=1.0)] = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class NmpcSettings(SettingsTable):
    """Settings of the law `nmpc-predictive`.

    tolerance_m: error that is not worth a correction, however certain it is.
    doubt_sigma: the law corrects an error once it exceeds the tolerance by so many σ of the average.
    doubt_sigma_first, doubt_sigma_unasked: the same for a new setpoint, and for a stem that nobody has moved yet.
    patience: growth of tolerance and σ with every correction of the same setpoint, as a part of them.
    patience_limit: the number of corrections at which they stop growing.
    brake_share: distance of the braking current from the middle of the target's stick band, as a part of F_s.
    brake_limit: the strongest braking, as a part of F_c: inside the stick band, or the valve would reverse.
    hold_step_ma: the current at rest follows the middle of the stick band when it is this far away.
    landing_sigma_m: σ of the average below which the end of a move may teach the table.
    approach: the plan of a move.
    adaptation: how far the valve may differ from its configuration, and how its friction wanders.
    breakaway: which samples of the stiction table a push uses.
    watch: whether a push has moved the stem.
    settle_s: time after a stop until the stem counts as resting.
    lagged: settings of an older version, which have no effect.
    """

    tolerance_m: Annotated[float, Interval(ge=1e-6, le=0.05)] = 5e-5
    doubt_sigma: Annotated[float, Interval(ge=0.0, le=20.0)] = 2.0
    doubt_sigma_first: Annotated[float, Interval(ge=0.0, le=20.0)] = 1.0
    doubt_sigma_unasked: Annotated[float, Interval(ge=0.0, le=20.0)] = 3.5
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
    lagged: dict[str, Any] = field(default_factory=dict)
