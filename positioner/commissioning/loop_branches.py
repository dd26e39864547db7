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

from positioner.commissioning.record import Kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from positioner.commissioning.procedure import ProcedureLimits
    from positioner.commissioning.record import Stretch
    from positioner.valve.parameters import ValveParameters

    Array = NDArray[np.float64]

_SMOOTH_S = 0.1
_SLID_OF_SPAN = 0.01
"""The stem slides steadily when it has gone so far from its rest, and lags have passed."""
_STEADY_S = 0.3
_END_OF_SPAN = 0.005
"""A stem that is so near to its end may stand at a stop already."""


@dataclass(frozen=True, slots=True)
class Branch:
    """One stroke: pressure in mA and smoothed reading in m, shape (samples,) each; slides: where it slides steadily.

    static_ma: the part of the pressure that spring and Coulomb friction take, where it slides: without F_v·v and the
    Stribeck part. direction: ±1. end_ma, end_m: pressure and place at the end, after the pause.
    """

    direction: float
    pressure_ma: Array
    static_ma: Array
    position_m: Array
    slides: NDArray[np.bool_]
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
    """Return a branch for each recorded stroke."""
    return tuple(_branch(each, valve, limits, period_s) for each in stretches if each.kind is Kind.STROKE)


def _branch(each: Stretch, valve: ValveParameters, limits: ProcedureLimits, period_s: float) -> Branch:
    width = max(round(_SMOOTH_S / period_s), 1)
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
        begin = moved[0] + round(_STEADY_S / period_s)
        slides[begin : min(ramp_end, int(ended[0])) - width] = True
    static_ma = pressure - each.direction * _of_speed_ma(position_m, width, valve, period_s)
    return Branch(each.direction, pressure, static_ma, position_m, slides, float(pressure[-1]), end_m)


def _of_speed_ma(position_m: Array, width: int, valve: ValveParameters, period_s: float) -> Array:
    """Return the friction that depends on the speed, F_v·v + (F_s - F_c)·e^(-(v/V_s)²), in mA, shape (samples,)."""
    half, end = width // 2 + 1, len(position_m) - 1
    at = np.arange(len(position_m))
    low, high = np.maximum(at - half, 0), np.minimum(at + half, end)
    speed = np.abs(position_m[high] - position_m[low]) / ((high - low) * period_s)
    ratio = speed / valve.stribeck_velocity_m_per_s
    excess_n = (valve.static_friction_n - valve.coulomb_friction_n) * np.exp(-np.minimum(ratio * ratio, 700.0))
    return np.asarray((valve.viscous_friction_n_s_per_m * speed + excess_n) / valve.force_gain_n_per_ma)


def smooth(values: Array, width: int) -> Array:
    """Return the mean over `width` samples around each one, shape (samples,); a lost reading does not count."""
    known = ~np.isnan(values)
    sums = np.r_[0.0, np.cumsum(np.where(known, values, 0.0))]
    counts = np.r_[0, np.cumsum(known)]
    at = np.arange(len(values))
    low, high = np.maximum(at - (width - 1) // 2, 0), np.minimum(at + width // 2 + 1, len(values))
    return np.asarray((sums[high] - sums[low]) / np.maximum(counts[high] - counts[low], 1))
