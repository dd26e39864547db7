"""How far the stem jumps before a slip is noticed and stopped: the smallest detectable jump of a ramp. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.sensor_lag import SensorLag
    from positioner.laws.nmpc.lagged.slip import Slip

_ENOUGH = 3.5
"""Σ d²/2σ² at which a displacement d counts as noticed."""
_LONGEST_S = 0.5


def detectable_jump(
    slip: Slip,
    sensor: SensorLag,
    x: float,
    rate_ma_per_s: float,
    delay_samples: int,
    sigma_m: float,
    brake_share: float,
) -> tuple[float, float]:
    """Return the jump J_det in m, and the time in s from the slip until it is noticed.

    Args:
        slip: the motion, which begins at its F_s.
        sensor: the lag of the readings.
        x: where the stem sticks, m.
        rate_ma_per_s: how fast the pressure rises.
        delay_samples: samples of dead time.
        sigma_m: standard deviation of a reading.
        brake_share: how far the braking pressure is from the middle of the stick band, as a part of F_s.
    """
    s, drive, period_s = slip.direction, slip.drive, slip.drive.period_s
    pressure_ma = slip.model.pressure_ma(slip.spring_n_per_m * x + s * slip.static_n)
    _, converter_ma = drive.ramp_ma(pressure_ma, s, rate_ma_per_s)
    here, v, seen, evidence, noticed_s = x, 0.0, x, 0.0, 0.0
    stopped = False
    while evidence < _ENOUGH and noticed_s < _LONGEST_S and not stopped:
        current_ma, _ = drive.ramp_ma(pressure_ma, s, rate_ma_per_s)
        before = here
        here, v, pressure_ma, converter_ma, stopped = slip.after(here, v, pressure_ma, converter_ma, current_ma)
        seen = sensor.after(before, here, seen)
        noticed_s += period_s
        evidence += (seen - x) * (seen - x) / (2.0 * sigma_m * sigma_m)
    for _ in range(delay_samples):
        if not stopped:
            here, v, pressure_ma, converter_ma, stopped = slip.after(here, v, pressure_ma, converter_ma, converter_ma)
    if not stopped:
        brake_ma = slip.model.pressure_ma(slip.spring_n_per_m * here - s * brake_share * slip.static_n)
        first_ma = drive.command_ma(pressure_ma, converter_ma, brake_ma)
        here = slip.stop_m(here, v, pressure_ma, converter_ma, first_ma, brake_ma)
    return s * (here - x), noticed_s
