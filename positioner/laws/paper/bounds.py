"""The movable bounds of the predictive controller: restVel (eqs 21-24) and breakaway (eqs 25, 26). Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable


class ApproachForm(StrEnum):
    """How the speed bound falls towards the setpoint."""

    EXPONENTIAL = "exponential"
    """Eq. 22, what the paper uses."""
    LINEAR = "linear"
    """Eq. 21."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundSettings(SettingsTable):
    """The `[control.bounds]` table of a configuration.

    approach_form: how the bound of the speed shrinks towards the target: "linear" (eq. 21), "exponential" (eq. 22).
    approach_span_m_per_s, approach_decay_per_m: α and β of eq. 22 (D6: the paper's 5 and 150 in SI;
        read in cm/s and 1/cm they are 0.05 and 15000).
    approach_gain_per_s: K of eq. 21, speed per distance.
    max_speed_m_per_s: largest speed in both directions, V_min and V_max of eqs 23 and 24.
    breakaway_tolerance_m: error below which the stem is left where it sticks.
    """

    approach_form: ApproachForm = ApproachForm.EXPONENTIAL
    approach_span_m_per_s: Annotated[float, Interval(gt=0.0, le=100.0)] = 5.0
    approach_decay_per_m: Annotated[float, Interval(gt=0.0, le=1e5)] = 150.0
    approach_gain_per_s: Annotated[float, Interval(gt=0.0, le=1e4)] = 100.0
    max_speed_m_per_s: Annotated[float, Interval(gt=0.0, le=100.0)] = 10.0
    breakaway_tolerance_m: Annotated[float, Interval(ge=0.0, le=0.1)] = 0.001


def approach_speed_limit_m_per_s(settings: BoundSettings, error_m: float, mean_stick_speed_m_per_s: float) -> float:
    """Return restVel in m/s at a distance |error| from the setpoint, for the learned speed v_Ag (eq. 21 or 22)."""
    distance = abs(error_m)
    if settings.approach_form is ApproachForm.LINEAR:
        return settings.approach_gain_per_s * distance + mean_stick_speed_m_per_s
    rise = -math.expm1(-settings.approach_decay_per_m * distance)
    return settings.approach_span_m_per_s * rise + mean_stick_speed_m_per_s


def speed_bounds_m_per_s(
    settings: BoundSettings, error_m: float, mean_stick_speed_m_per_s: float | None
) -> tuple[float, float]:
    """Return the bounds on the speed: restVel towards the setpoint, V_min or V_max away from it (eqs 23, 24).

    Without a learned speed there is no movable bound (paper §5.3).
    """
    free = settings.max_speed_m_per_s
    if mean_stick_speed_m_per_s is None:
        return -free, free
    limit = min(approach_speed_limit_m_per_s(settings, error_m, mean_stick_speed_m_per_s), free)
    return (-free, limit) if error_m > 0.0 else (-limit, free)


def breakaway_bounds_ma(
    error_m: float, breakaway_ma: float | None, current_low_ma: float, current_high_ma: float
) -> tuple[float, float]:
    """Return the bounds on the current that release a stuck stem: Γ ≤ u when opening, u ≤ Γ when closing (eqs 25, 26).

    D8: per direction, and never beyond what the loop can carry.
    """
    if breakaway_ma is None:
        return current_low_ma, current_high_ma
    inside = min(max(breakaway_ma, current_low_ma), current_high_ma)
    return (inside, current_high_ma) if error_m > 0.0 else (current_low_ma, inside)
