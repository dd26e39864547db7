"""The kinds of motion with a closed form: coasting, breaking away, creeping. Pure.

Each function returns the motion segment that starts from the stem's position and velocity and ends at its first event.
Inside a segment the stem moves one way, so that the crossing of a border is the crossing of a monotone curve.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from plant_emulator.oscillator import Glide
from plant_emulator.path import Uniform
from plant_emulator.roots import TIME_TOLERANCE_S, clear_time, clear_within, crossing, first_event
from plant_emulator.segment import Ending, Segment

if TYPE_CHECKING:
    from plant_emulator.constants import Constants
    from plant_emulator.force import PushingForce
    from plant_emulator.friction import Packing
    from plant_emulator.stem import Stem


def coast(
    constants: Constants, stem: Stem, packing: Packing, force: PushingForce, horizon_s: float, border_m: float
) -> Segment:
    """Return the segment of fast sliding against F_c and F_v, down to the speed at which the Stribeck term begins."""
    x, v, direction = stem.position_m, stem.velocity_m_per_s, stem.direction
    low = constants.flat_m_per_s
    glide = Glide(
        constants.sliding, x, v, force, constants.preload_n + packing.one_way_n + direction * packing.coulomb_n
    )

    def clear(t: float) -> float:
        at_x, at_v = glide.at(t) if t else (x, v)
        a = glide.acceleration(t, at_x, at_v)
        gap, slope, left_s = direction * at_v - low, direction * a, horizon_s - t
        stride = clear_time(gap, slope, glide.jerk_bound(t, at_v, a, left_s))
        if not force.is_simple:
            stride = clear_within(gap, slope, stride, left_s, lambda window_s: glide.jerk_bound(t, at_v, a, window_s))
        # a stem that starts at the bound and accelerates has not fallen to it
        return max(stride, 2.0 * TIME_TOLERANCE_S) if t == 0.0 and direction * a > 0.0 else stride

    t, fell = first_event(clear, horizon_s)
    end_x, end_v = glide.at(t)
    if direction * (end_x - border_m) >= 0.0:
        return _to_border(glide, t, border_m)
    if fell:
        return Segment(t, end_x, direction * low, Ending.SPEED, glide)
    return Segment(t, end_x, end_v, Ending.OPEN, glide)


def break_away(
    constants: Constants,
    stem: Stem,
    packing: Packing,
    force: PushingForce,
    horizon_s: float,
    border_m: float,
    *,
    direction: int,
) -> Segment:
    """Return the segment inside the zero-speed band against F_s, under a pull in `direction`.

    It ends at DV, or at zero speed when the stem still moves against `direction`, or where F_s can hold the stem.
    """
    x, v = stem.position_m, stem.velocity_m_per_s
    glide = Glide(
        constants.breaking, x, v, force, constants.preload_n + packing.one_way_n + direction * packing.static_n
    )
    turning = direction * v < 0.0
    level = 0.0 if turning else constants.band_m_per_s

    def clear(t: float) -> tuple[float, float]:
        at_x, at_v = glide.at(t)
        a = glide.acceleration(t, at_x, at_v)
        jerk_bound = glide.jerk_bound(t, at_v, a, horizon_s - t)
        snap_bound = glide.snap_bound(t, at_v, a, horizon_s - t)
        to_level = clear_time(level - direction * at_v, -direction * a, jerk_bound)
        return to_level, clear_time(direction * a, direction * glide.jerk(t, at_v, a), snap_bound)

    t, ended = first_event(lambda instant: min(clear(instant)), horizon_s)
    end_x, end_v = glide.at(t)
    moving = -direction if turning else direction
    if moving * (end_x - border_m) >= 0.0:
        return _to_border(glide, t, border_m)
    if not ended:
        return Segment(t, end_x, end_v, Ending.OPEN, glide)
    if clear(t)[0] < TIME_TOLERANCE_S:
        return Segment(t, end_x, direction * level, Ending.SPEED, glide)
    return Segment(t, end_x, 0.0, Ending.BALANCE, glide)


def creep(
    constants: Constants,
    stem: Stem,
    packing: Packing,
    force: PushingForce,
    horizon_s: float,
    border_m: float,
    *,
    direction: int,
    limit_n: float,
) -> Segment:
    """Return the segment at exactly DV in `direction`, while the pull is above F_s and below `limit_n`.

    At `limit_n` the pull is strong enough to make the stem slide.
    """
    x = stem.position_m
    v = direction * constants.band_m_per_s
    path = Uniform(x, v)
    bend, preload_n = force.bend_bound(0.0), constants.preload_n + packing.one_way_n

    def clear(t: float) -> tuple[float, float]:
        pull = direction * (force.at(t) - preload_n - constants.spring_n_per_m * (x + v * t))
        slope = direction * (force.slope(t) - constants.spring_n_per_m * v)
        return clear_time(pull - packing.static_n, slope, bend), clear_time(limit_n - pull, -slope, bend)

    t, ended = first_event(lambda instant: min(clear(instant)), horizon_s)
    if direction * (x + v * t - border_m) >= 0.0:
        return Segment((border_m - x) / v, border_m, v, Ending.BORDER, path)
    if not ended:
        return Segment(t, x + v * t, v, Ending.OPEN, path)
    held = clear(t)[0] < TIME_TOLERANCE_S
    return Segment(t, x + v * t, 0.0 if held else v, Ending.BALANCE if held else Ending.SPEED, path)


def _to_border(glide: Glide, latest_s: float, border_m: float) -> Segment:
    t = crossing(lambda instant: glide.at(instant)[0] - border_m, 0.0, latest_s)
    return Segment(t, border_m, glide.at(t)[1], Ending.BORDER, glide)
