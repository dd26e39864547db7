"""The motion of many slips at once, for many sets of parameters: what the fit compares with the readings. Pure.

ṗ = (u(t - T_d) - p)/τ, with the τ of filling while u exceeds p and that of venting below, p in mA; and
m·v̇ = B·p - F_0 - K·x - F_v·v - s·[F_c + (F_s - F_c)·e^(-(v/V_s)²)], eqs 4 and 11. `valve/motion` has the closed form of
the second equation without its Stribeck term. That term decides where a stem with strong damping (graphite packing)
begins to slide, so it is needed here; and arrays are, because a fit plays hundreds of slips a hundred times.

Speed is integrated exactly over a short step in which spring and friction count as constant. A stem that stops stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_MOST_EXPONENT = 60.0
_MOST_WITHIN = 6


@dataclass(frozen=True, slots=True)
class Slips:
    """Slips of one experiment, side by side in arrays of (slip, sample), NaN where there is no reading.

    direction: ±1 of each; begins: the sample from which on a slip is played; before it the stem rests.
    step_s: of the integration, at most. seen: the sample in which the procedure saw each of them slip, where it did.
    """

    period_s: float
    direction: Array
    applied_ma: Array
    measured_m: Array
    begins: int
    step_s: float = 2.5e-4
    seen: int = 0


@dataclass(frozen=True, slots=True)
class Candidates:
    """Sets of parameters in arrays of (set, 1), and of (set, slip) for rest_m; forces in N, B in N/mA.

    friction: a factor on F_s and F_c, of (set, slip).
    """

    mass_kg: float
    gain_n_per_ma: float
    spring_n_per_m: Array
    preload_n: Array
    static_n: Array
    coulomb_n: Array
    viscous_n_s_per_m: Array
    stribeck_m_per_s: Array
    fill_s: Array
    vent_s: Array
    dead_s: Array
    rest_m: Array
    friction: Array


def substeps_of(slips: Slips, sets: Candidates) -> int:
    """Return into how many parts a step is divided: with strong damping speed follows friction within microseconds."""
    return min(max(int(np.median(_damping(sets, _steps_of(slips)[1]))), 1), _MOST_WITHIN)


def play(slips: Slips, sets: Candidates) -> Array:
    """Return the position in m at each reading from `begins` on, as an array of (sample, set, slip)."""
    count, period_s = slips.applied_ma.shape[1], slips.period_s
    steps, step_s = _steps_of(slips)
    delay = sets.dead_s / period_s
    whole = np.floor(delay).astype(np.int64)
    late_s = (delay - whole) * period_s
    number = np.arange(slips.applied_ma.shape[0])[None, :]
    fill, vent = _decay(sets.fill_s, step_s), _decay(sets.vent_s, step_s)
    fill_mean, vent_mean = _mean_decay(sets.fill_s, step_s), _mean_decay(sets.vent_s, step_s)
    rest_fill, rest_vent = _decay(sets.fill_s, period_s), _decay(sets.vent_s, period_s)
    # of the step j the part before the new command acts
    parts = [np.clip((late_s - j * step_s) / step_s, 0.0, 1.0) for j in range(steps)]
    late_part = late_s / period_s
    gain, side = sets.gain_n_per_ma, slips.direction[None, :]
    static_n, coulomb_n = sets.static_n * sets.friction, sets.coulomb_n * sets.friction
    excess_n = static_n - coulomb_n
    spring, inverse = sets.spring_n_per_m, 1.0 / sets.stribeck_m_per_s
    viscous, within = np.maximum(sets.viscous_n_s_per_m, 1e-3), substeps_of(slips, sets)
    part_s = step_s / within
    fade = np.exp(-_damping(sets, step_s) / within)
    lag_s = (sets.mass_kg / viscous) * (1.0 - fade)
    load_n = sets.preload_n + spring * sets.rest_m
    pressure = np.broadcast_to(slips.applied_ma[:, 0][None, :], load_n.shape).copy()
    way, speed = np.zeros_like(load_n), np.zeros_like(load_n)
    found = np.empty((count - slips.begins, *load_n.shape))
    for k in range(count):
        new = slips.applied_ma[number, np.maximum(k - whole, 0)]
        old = slips.applied_ma[number, np.maximum(k - whole - 1, 0)]
        if k < slips.begins:
            target = late_part * old + (1.0 - late_part) * new
            pressure = target + (pressure - target) * np.where(target > pressure, rest_fill, rest_vent)
            continue
        highest = np.maximum(np.maximum(side * pressure, side * new), side * old)
        rests = not speed.any() and bool(np.all(gain * highest - side * load_n - spring * way < static_n))
        for j in range(steps):
            target = new if steps == 1 and not late_part.any() else parts[j] * old + (1.0 - parts[j]) * new
            off = pressure - target
            rises = off < 0.0
            mean = target + off * np.where(rises, fill_mean, vent_mean)
            pressure = target + off * np.where(rises, fill, vent)
            if rests:
                continue
            push_n = side * (gain * mean - load_n) - coulomb_n - spring * (way + 0.5 * step_s * speed)
            for _ in range(within):
                way, speed = _slid(way, speed, push_n, excess_n, viscous, inverse, fade, part_s, lag_s)
        found[k - slips.begins] = way
    return sets.rest_m + side * found


def _slid(
    way: Array,
    speed: Array,
    push_n: Array,
    excess_n: Array,
    viscous: Array,
    inverse: Array,
    fade: Array,
    part_s: float,
    lag_s: Array,
) -> tuple[Array, Array]:
    """Return way in m and speed in m/s after a step of `part_s`; inverse: 1/V_s in s/m; fade: e^(-F_v·part_s/m)."""
    ratio = speed * inverse
    final = (push_n - excess_n * np.exp(-ratio * ratio)) / viscous
    after = final + (speed - final) * fade
    goes = after > 0.0
    # again, with the friction of the middle of the step: a fast slip leaves F_s within microseconds
    ratio = 0.5 * (speed + after) * inverse
    final = (push_n - excess_n * np.exp(-ratio * ratio)) / viscous
    after = final + (speed - final) * fade
    way = way + np.maximum(final * part_s + (speed - final) * lag_s, 0.0) * (goes | (speed > 0.0))
    return way, np.where(goes, np.maximum(after, 0.0), 0.0)


def _steps_of(slips: Slips) -> tuple[int, float]:
    """Return the steps of a period, and their length in s."""
    steps = max(int(np.ceil(slips.period_s / slips.step_s - 1e-9)), 1)
    return steps, slips.period_s / steps


def _damping(sets: Candidates, step_s: float) -> Array:
    """Return F_v·t/m of a step, as an array of (set, 1)."""
    return np.asarray(np.minimum(np.maximum(sets.viscous_n_s_per_m, 1e-3) * step_s / sets.mass_kg, _MOST_EXPONENT))


def _decay(time_constant_s: Array, duration_s: float) -> Array:
    """Return e^(-t/τ), 0 for no lag."""
    return np.asarray(np.exp(-duration_s / np.maximum(time_constant_s, 1e-9)))


def _mean_decay(time_constant_s: Array, duration_s: float) -> Array:
    """Return the mean of e^(-t/τ) over the duration."""
    tau = np.maximum(time_constant_s, 1e-9)
    return np.asarray(-np.expm1(-duration_s / tau) * tau / duration_s)
