"""The setpoint that a law pursues, from reading to reading: filter, rate, limits of the travel, tight shut-off. Pure.

Shut-off comes last and overrides the limits. It ends where the travel comes back by the hysteresis, so that a setpoint
that trembles at its border does not open and close the valve.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.setpoint.characteristic import travel_of
from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.setpoint.settings import SetpointSettings
    from positioner.valve.parameters import ValveParameters


@dataclass(frozen=True, slots=True)
class SetpointPath:
    """travel: behind filter and rate, None before the first setpoint. shut: -1 shut off, +1 fully open, else 0."""

    travel: float | None = None
    shut: int = 0


NEW_PATH = SetpointPath()


def followed(
    settings: SetpointSettings,
    valve: ValveParameters,
    path: SetpointPath,
    asked_m: float,
    here_m: float,
    elapsed_s: float,
) -> tuple[SetpointPath, float]:
    """Return the path after `elapsed_s`, and the setpoint in m that the law pursues.

    The host asks for `asked_m`. A new path begins at `here_m`.
    """
    zero_m, span_m = valve.travel_min_m, valve.span_m
    wanted = travel_of(settings, (asked_m - zero_m) / span_m)
    before = path.travel
    if before is None:
        before = min(max((here_m - zero_m) / span_m, 0.0), 1.0)
    travel = wanted
    if settings.filter_s > 0.0:
        travel += math.exp(-elapsed_s / settings.filter_s) * (before - wanted)
    if settings.opening_per_s > 0.0:
        travel = min(travel, before + settings.opening_per_s * elapsed_s)
    if settings.closing_per_s > 0.0:
        travel = max(travel, before - settings.closing_per_s * elapsed_s)
    shut = _shut(settings, path.shut, travel)
    limited = min(max(travel, settings.travel_low), settings.travel_high)
    if shut:
        limited = 1.0 if shut > 0 else 0.0
    target_m = min(max(zero_m + limited * span_m, valve.travel_min_m), valve.travel_max_m)
    return SetpointPath(travel, shut), target_m


def _shut(settings: SetpointSettings, before: int, travel: float) -> int:
    back = settings.hysteresis
    if settings.closed_below > 0.0 and travel <= settings.closed_below + (back if before < 0 else 0.0):
        return -1
    if settings.open_above < 1.0 and travel >= settings.open_above - (back if before > 0 else 0.0):
        return 1
    return 0
