"""The `[control.nmpc.lagged]` table of a configuration: the law `nmpc` on a valve with actuator lag. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable


@dataclass(frozen=True, slots=True, kw_only=True)
class LaggedSettings(SettingsTable):
    """Settings for a valve whose pressure follows the current with a lag.

    tolerance_of_span, tolerance_of_noise: error that is not worth a correction: a part of the span, and of the σ of a
        reading, as a root of squares.
    patience: growth of the tolerance with every correction of the same setpoint, as a part of it.
    most_corrections: after so many corrections of one setpoint the stem stays.
    certain_part: the stem is known well enough when σ of its average is below this part of the tolerance.
    spring_doubt, friction_doubt, lag_doubt: standard deviations of the configured K, F_s and lag, as parts of them.
    brake_share: distance of the braking pressure from the middle of the target's stick band, as a part of F_s.
    brake_limit: the strongest braking, as a part of F_c: inside the stick band, or the valve would reverse.
    brake_reserve: the share of the current's range, at each end, that a planned brake leaves unused.
    slew_reserve: the share of the slew limit that a planned brake leaves unused.
    fastest_m_per_s: the cap of the speed.
    ramp_share: rise of the pressure while a slip is noticed, as a part of (F_s - F_c)/B, on the slowest ramp.
    ramp_reach: the fastest ramp is taken whose detectable jump is below this part of the error.
    verdict: probability of a slip at which it counts as certain.
    force_noise_n: force that the model does not know, white per sample, while sliding.
    friction_per_m: how much F_c wanders per metre, as a part of it.
    landing_share: uncertainty of a landing as a part of the natural jump (F_s - F_c)/K.
    bias_gain: how much of a landing's error goes into the landing bias.
    settle_s: time after a stop until the stem counts as resting.
    """

    tolerance_of_span: Annotated[float, Interval(gt=0.0, le=0.1)] = 0.0006
    tolerance_of_noise: Annotated[float, Interval(ge=0.0, le=10.0)] = 0.15
    patience: Annotated[float, Interval(ge=0.0, le=10.0)] = 0.12
    most_corrections: Annotated[int, Interval(ge=0, le=1000)] = 10
    certain_part: Annotated[float, Interval(gt=0.0, le=1.0)] = 0.4
    spring_doubt: Annotated[float, Interval(gt=0.0, le=0.5)] = 0.05
    friction_doubt: Annotated[float, Interval(gt=0.0, le=0.5)] = 0.12
    lag_doubt: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.2
    brake_share: Annotated[float, Interval(ge=0.0, lt=1.0)] = 0.5
    brake_limit: Annotated[float, Interval(ge=0.0, lt=1.0)] = 0.9
    brake_reserve: Annotated[float, Interval(ge=0.0, lt=0.4)] = 0.2
    slew_reserve: Annotated[float, Interval(ge=0.0, lt=1.0)] = 0.4
    fastest_m_per_s: Annotated[float, Interval(gt=0.0, le=100.0)] = 1.0
    ramp_share: Annotated[float, Interval(gt=0.0, le=1.0)] = 0.12
    ramp_reach: Annotated[float, Interval(gt=0.0, le=1.0)] = 0.6
    verdict: Annotated[float, Interval(gt=0.5, lt=1.0)] = 0.9
    force_noise_n: Annotated[float, Interval(ge=0.0, le=1e5)] = 60.0
    friction_per_m: Annotated[float, Interval(ge=0.0, le=100.0)] = 0.3
    landing_share: Annotated[float, Interval(gt=0.0, le=1.0)] = 0.055
    bias_gain: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.3
    settle_s: Annotated[float, Interval(ge=0.0, le=1.0)] = 0.004
