"""The current that leads a slipping stem to its target: as fast as it can still be stopped there. Pure.

The pressure is driven between that which brakes (p_b, inside the stick band of the target) and that which keeps the
speed at its cap. One sample of the current, then the brake, must stop the stem at the target: a root of the predicted
stop, by the secant method with a bracket.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.slip import Slip

_PASSES = 8
_CLOSE_M = 2e-6
"""A predicted stop this close to the target is there."""


def stopping_current_ma(
    slip: Slip,
    x: float,
    v: float,
    pressure_ma: float,
    converter_ma: float,
    target_m: float,
    brake_ma: float,
    hardest_ma: float,
    fastest_m_per_s: float,
    reserve: float,
    slew_reserve: float,
) -> float:
    """Return the current in mA for one sample of a stem at x (m) with v (m/s) that is to stop at `target_m`.

    Args:
        slip: the motion.
        x: position of the stem, m.
        v: its speed, m/s.
        pressure_ma: the pressure on which the current begins to act.
        converter_ma: the output of the I/P converter then.
        target_m: where the stem is to stop.
        brake_ma: the pressure that is planned to brake it.
        hardest_ma: the pressure that brakes it as hard as may be, where the plan was too late.
        fastest_m_per_s: cap of the speed.
        reserve: share of the current's range that the planned brake leaves unused.
        slew_reserve: share of the slew limit that it leaves unused.
    """
    s, drive = slip.direction, slip.drive
    brake = slip.with_drive(drive.with_reserve(reserve, slew_reserve))
    drag_n = slip.sliding_n + slip.model.viscous_n_s_per_m * fastest_m_per_s
    cruise_ma = slip.model.pressure_ma(slip.spring_n_per_m * x + s * drag_n)
    low = drive.command_ma(pressure_ma, converter_ma, hardest_ma)
    high = drive.command_ma(pressure_ma, converter_ma, cruise_ma)
    if s * (high - low) <= 0.0:
        return low
    beyond = s * (_stop_m(slip, brake, x, v, pressure_ma, converter_ma, high, brake_ma) - target_m)
    if beyond <= 0.0:
        return high
    short = s * (_stop_m(slip, brake, x, v, pressure_ma, converter_ma, low, brake_ma) - target_m)
    if short >= 0.0:
        return low
    side = 0
    for _ in range(_PASSES):
        # the Illinois variant of the secant method keeps the root between the two
        middle = low + (high - low) * short / (short - beyond)
        error = s * (_stop_m(slip, brake, x, v, pressure_ma, converter_ma, middle, brake_ma) - target_m)
        if abs(error) < _CLOSE_M:
            return middle
        if error > 0.0:
            high, beyond = middle, error
            short *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            low, short = middle, error
            beyond *= 0.5 if side < 0 else 1.0
            side = -1
    return low + (high - low) * short / (short - beyond)


def _stop_m(
    slip: Slip,
    brake: Slip,
    x: float,
    v: float,
    pressure_ma: float,
    converter_ma: float,
    first_ma: float,
    brake_ma: float,
) -> float:
    """Return where in m the stem stops after one sample under `first_ma`, then braked with the drive of `brake`."""
    x, v, pressure_ma, converter_ma, stopped = slip.after(x, v, pressure_ma, converter_ma, first_ma)
    return x if stopped else brake.braked_m(x, v, pressure_ma, converter_ma, brake_ma)
