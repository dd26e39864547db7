"""The kinds of motion between two events: coasting, breaking away, creeping. Pure.

Each function returns the leg from a position and a velocity on, until its first event. Inside a leg the stem moves one
way, so that a border it comes to is a crossing of a monotone curve.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from plant_emulator.leg import Ending, Leg
from plant_emulator.oscillator import Glide
from plant_emulator.roots import TIME_TOLERANCE_S, clear_time, crossing, first_event

if TYPE_CHECKING:
    from plant_emulator.mechanics import Mechanics
    from plant_emulator.oscillator import PushingForce


def coast(
    mechanics: Mechanics,
    x: float,
    v: float,
    direction: int,
    force: PushingForce,
    coulomb_n: float,
    horizon_s: float,
    border_m: float,
) -> Leg:
    """Return the leg of fast sliding against F_c and F_v, until the speed falls to where the Stribeck term begins."""
    low = mechanics.flat_m_per_s
    glide = Glide(mechanics.sliding, x, v, force, mechanics.settings.valve.bench_set_n + direction * coulomb_n)

    def clear(t: float) -> float:
        at_x, at_v = glide.at(t) if t else (x, v)
        a = glide.acceleration(t, at_x, at_v)
        stride = clear_time(direction * at_v - low, direction * a, glide.jerk_bound(t, at_v, a, horizon_s - t))
        # a stem that sets out from the bound is on it, but not falling to it
        return max(stride, 2.0 * TIME_TOLERANCE_S) if t == 0.0 and direction * a > 0.0 else stride

    t, fell = first_event(clear, horizon_s)
    end_x, end_v = glide.at(t)
    if direction * (end_x - border_m) >= 0.0:
        return _to_border(glide, t, border_m)
    return Leg(t, end_x, direction * low, Ending.SPEED) if fell else Leg(t, end_x, end_v, Ending.OPEN)


def break_away(
    mechanics: Mechanics,
    x: float,
    v: float,
    direction: int,
    force: PushingForce,
    static_n: float,
    horizon_s: float,
    border_m: float,
) -> Leg:
    """Return the leg inside the zero-speed band against F_s, pulled to the side of `direction`.

    It ends at DV, or at zero speed when the stem still moves the other way, or where F_s can hold the stem.
    """
    glide = Glide(mechanics.breaking, x, v, force, mechanics.settings.valve.bench_set_n + direction * static_n)
    turning = direction * v < 0.0
    level = 0.0 if turning else mechanics.band_m_per_s

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
        return Leg(t, end_x, end_v, Ending.OPEN)
    if clear(t)[0] < TIME_TOLERANCE_S:
        return Leg(t, end_x, direction * level, Ending.SPEED)
    return Leg(t, end_x, 0.0, Ending.BALANCE)


def creep(
    mechanics: Mechanics,
    x: float,
    direction: int,
    force: PushingForce,
    static_n: float,
    limit_n: float,
    horizon_s: float,
    border_m: float,
) -> Leg:
    """Return the leg at DV exactly, while the pull is above F_s, yet below `limit_n`, where it makes the stem slide."""
    valve = mechanics.settings.valve
    v = direction * mechanics.band_m_per_s
    bend = abs(force.deviation_n) * force.rate_per_s**2

    def clear(t: float) -> tuple[float, float]:
        pull = direction * (force.at(t) - valve.bench_set_n - valve.spring_rate_n_per_m * (x + v * t))
        slope = direction * (force.slope(t) - valve.spring_rate_n_per_m * v)
        return clear_time(pull - static_n, slope, bend), clear_time(limit_n - pull, -slope, bend)

    t, ended = first_event(lambda instant: min(clear(instant)), horizon_s)
    if direction * (x + v * t - border_m) >= 0.0:
        return Leg((border_m - x) / v, border_m, v, Ending.BORDER)
    if not ended:
        return Leg(t, x + v * t, v, Ending.OPEN)
    held = clear(t)[0] < TIME_TOLERANCE_S
    return Leg(t, x + v * t, 0.0 if held else v, Ending.BALANCE if held else Ending.SPEED)


def _to_border(glide: Glide, latest_s: float, border_m: float) -> Leg:
    t = crossing(lambda instant: glide.at(instant)[0] - border_m, 0.0, latest_s)
    return Leg(t, border_m, glide.at(t)[1], Ending.BORDER)
