"""The two branches of a signature: where the stem slides up and down, over the pressure that drives it. Pure.

The pressure is the measured one where the hardware sends it. Otherwise it follows from the current by the configured
lags of the actuator: in mA, like the current that would hold it. A lag of the sensor delays the reading, which is the
same as a pressure that comes earlier, so the pressure is delayed by it, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from positioner.commissioning.readings import smooth
from positioner.commissioning.record import Kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.commissioning.procedure import ProcedureLimits
    from positioner.commissioning.record import Stretch
    from positioner.valve.parameters import ValveParameters

    Array = NDArray[np.float64]

_SMOOTH_S, _SMOOTH_M = 0.1, 0.001
"""Position and pressure are means over this time, and at most over this way."""
_SLID_OF_SPAN = 0.01
"""The stem slides steadily when it has gone so far from its rest, and what came before has faded."""
_STEADY_S, _SOON_S, _TIME_CONSTANTS = 0.3, 0.02, 5.0
_WATCHED_MA, _STANDS, _STANDING = 0.3, 0.25, 0.1
"""A stem slides by stick-slip where it is slower than a quarter of its mean speed, for a tenth of the way."""
_END_OF_SPAN = 0.005
"""A stem that is so near to its end may stand at a stop already."""


@dataclass(frozen=True, slots=True)
class Branch:
    """One stroke: pressure in mA and smoothed reading in m, shape (samples,) each; slides: where it slides steadily.

    static_ma: the part of the pressure that spring and Coulomb friction take, where it slides: without F_v·v and the
    Stribeck part. direction: ±1. end_ma, end_m: pressure and place at the end, after the pause. current_ma: the loop
    current. sticks: whether the stem stood again and again.
    """

    direction: float
    rate_ma_per_s: float
    current_ma: Array
    pressure_ma: Array
    static_ma: Array
    position_m: Array
    slides: NDArray[np.bool_]
    sticks: bool
    end_ma: float
    end_m: float


def pressures_ma(each: Stretch, valve: ValveParameters, period_s: float) -> Array:
    """Return the pressure at each reading of a stretch in mA, shape (samples,)."""
    actuator = valve.actuator
    if each.pressure_pa:
        driven = np.asarray(each.pressure_pa) / valve.pressure_gain_pa_per_ma
    else:
        late = round(actuator.dead_time_s / period_s)
        currents = np.asarray(each.applied_ma)
        currents = np.r_[np.full(min(late, len(currents)), currents[0]), currents[: len(currents) - late]]
        driven = lagged(currents, actuator.converter_time_constant_s, actuator.converter_time_constant_s, period_s)
        driven = lagged(driven, actuator.fill_time_constant_s, actuator.vent_time_constant_s, period_s)
    return lagged(driven, valve.sensor_time_constant_s, valve.sensor_time_constant_s, period_s)


def lagged(drive: Array, fill_s: float, vent_s: float, period_s: float) -> Array:
    """Return a drive behind a first-order lag, shape (samples,); it begins at the drive's first value."""
    if fill_s == 0.0 and vent_s == 0.0:
        return drive
    filling, venting = (1.0 - math.exp(-period_s / each) if each else 1.0 for each in (fill_s, vent_s))
    found, here = np.empty_like(drive), float(drive[0])
    for number, there in enumerate(drive.tolist()):
        here += (filling if there > here else venting) * (there - here)
        found[number] = here
    return found


def branches(
    stretches: Sequence[Stretch], valve: ValveParameters, limits: ProcedureLimits, period_s: float
) -> tuple[Branch, ...]:
    """Return a branch for each recorded stroke, slow and quick ones."""
    return tuple(_branch(each, valve, limits, period_s) for each in stretches if each.kind is Kind.STROKE)


def slow_and_sliding(found: Sequence[Branch]) -> tuple[tuple[Branch, ...], tuple[Branch, ...]]:
    """Return the slow strokes, and those that show the sliding stem: the quick ones if it stuck in the slow ones."""
    rates = sorted({each.rate_ma_per_s for each in found})
    slow, quick = (tuple(each for each in found if each.rate_ma_per_s == rate) for rate in (rates[0], rates[-1]))
    return slow, quick if any(each.sticks for each in slow) else slow


def _branch(each: Stretch, valve: ValveParameters, limits: ProcedureLimits, period_s: float) -> Branch:
    rate = each.rate_ma_per_s
    expected_m_per_s = rate * valve.force_gain_n_per_ma / valve.spring_rate_n_per_m
    width = max(round(min(_SMOOTH_S, _SMOOTH_M / expected_m_per_s) / period_s), 1)
    position_m = smooth(np.asarray(each.measured_m), width)
    pressure = smooth(pressures_ma(each, valve, period_s), width)
    currents = np.asarray(each.applied_ma)
    ramp_end = int(np.flatnonzero(currents != currents[-1])[-1])
    gone_m = each.direction * (position_m - position_m[width])
    moved = np.flatnonzero(gone_m > max(_SLID_OF_SPAN * limits.span_m, 0.15 * float(gone_m.max())))
    end_m = float(np.nanmean(position_m[-width:]))
    ended = np.flatnonzero(each.direction * (end_m - position_m) < _END_OF_SPAN * limits.span_m)
    slides = np.zeros(len(position_m), dtype=bool)
    if len(moved):
        fades_s = _SOON_S + _TIME_CONSTANTS * valve.viscous_friction_n_s_per_m / valve.spring_rate_n_per_m
        begin = moved[0] + round(min(_STEADY_S, fades_s) / period_s)
        slides[begin : min(ramp_end, int(ended[0])) - width] = True
    static_ma = pressure - each.direction * _of_speed_ma(position_m, width, valve, period_s)
    ways_m = np.abs(np.diff(position_m[slides][:: max(round(_WATCHED_MA / rate / period_s), 1)]))
    return Branch(
        each.direction,
        rate,
        currents,
        pressure,
        static_ma,
        position_m,
        slides,
        bool(len(ways_m)) and float(np.mean(ways_m < _STANDS * np.mean(ways_m))) > _STANDING,
        float(pressure[-1]),
        end_m,
    )


def _of_speed_ma(position_m: Array, width: int, valve: ValveParameters, period_s: float) -> Array:
    """Return the friction that depends on the speed, F_v·v + (F_s - F_c)·e^(-(v/V_s)²), in mA, shape (samples,)."""
    half, end = width // 2 + 1, len(position_m) - 1
    at = np.arange(len(position_m))
    low, high = np.maximum(at - half, 0), np.minimum(at + half, end)
    speed = np.abs(position_m[high] - position_m[low]) / ((high - low) * period_s)
    ratio = speed / valve.stribeck_velocity_m_per_s
    excess_n = (valve.static_friction_n - valve.coulomb_friction_n) * np.exp(-np.minimum(ratio * ratio, 700.0))
    return np.asarray((valve.viscous_friction_n_s_per_m * speed + excess_n) / valve.force_gain_n_per_ma)
