"""From the stem to the reading: backlash in the linkage, then a first-order lag; exact along each segment. Pure.

Inside a segment the stem moves one way. So the play is taken up at most once, at an instant that is located. The lag
has a closed form along each kind of motion.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from plant_emulator.roots import crossing
from positioner.values import dataclass

if TYPE_CHECKING:
    from plant_emulator.path import Path
    from plant_emulator.sensor_settings import SensorSettings


@dataclass(frozen=True, slots=True)
class Feedback:
    """The position in m of the sensor's lever, behind the backlash, and the position that the sensor shows."""

    lever_m: float
    shown_m: float


def is_direct(settings: SensorSettings) -> bool:
    """Return whether the sensor shows the stem as it is."""
    return settings.backlash_m == 0.0 and settings.time_constant_s == 0.0


def after_rest(settings: SensorSettings, feedback: Feedback, duration_s: float) -> Feedback:
    """Return the feedback after the stem rested for `duration_s`."""
    lever_m = feedback.lever_m
    if settings.time_constant_s == 0.0:
        return Feedback(lever_m, lever_m)
    fading = math.exp(-duration_s / settings.time_constant_s)
    return Feedback(lever_m, lever_m + (feedback.shown_m - lever_m) * fading)


def after_motion(settings: SensorSettings, feedback: Feedback, path: Path, end_m: float, duration_s: float) -> Feedback:
    """Return the feedback after the stem went along `path` to `end_m` in `duration_s`."""
    half_m, lever_m = 0.5 * settings.backlash_m, feedback.lever_m
    end_lever_m = min(max(lever_m, end_m - half_m), end_m + half_m)
    if end_lever_m == lever_m:
        return after_rest(settings, feedback, duration_s)
    if settings.time_constant_s == 0.0:
        return Feedback(end_lever_m, end_lever_m)
    rate, beside_m = 1.0 / settings.time_constant_s, end_lever_m - end_m
    shown_m = path.lagged(duration_s, rate)
    if half_m == 0.0:
        return Feedback(end_lever_m, feedback.shown_m * math.exp(-rate * duration_s) + shown_m)
    taken_s = crossing(lambda t: path.position(t) + beside_m - lever_m, 0.0, duration_s)
    taken = after_rest(settings, feedback, taken_s)
    fading = math.exp(-rate * (duration_s - taken_s))
    followed_m = shown_m - fading * path.lagged(taken_s, rate) + beside_m * (1.0 - fading)
    return Feedback(end_lever_m, taken.shown_m * fading + followed_m)
