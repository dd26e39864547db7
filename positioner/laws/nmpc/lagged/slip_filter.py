"""Where the slipping stem is, how fast, and what brakes it: an extended Kalman filter on x, v, F_c and y. Pure.

The fourth state y is what the sensor shows: x itself, or x with the sensor's lag.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.pipeline import Pipeline
    from positioner.laws.nmpc.lagged.sensor_lag import SensorLag
    from positioner.laws.nmpc.lagged.slip import Slip

_SMALL_M, _SMALL_M_PER_S, _SMALL_OF_FRICTION = 1e-6, 1e-4, 1e-3
"""Steps of the finite differences."""


@dataclass(frozen=True, slots=True)
class SlipCovariance:
    """The upper triangle of the covariance of x (m), v (m/s), F_c (N) and the reading y (m): f and y in names."""

    xx: float
    xv: float
    xf: float
    xy: float
    vv: float
    vf: float
    vy: float
    ff: float
    fy: float
    yy: float


@dataclass(frozen=True, slots=True)
class SlipState:
    """A slipping stem: x (m), v (m/s), F_c (N), what the sensor shows (m), and their covariance."""

    x: float
    v: float
    sliding_n: float
    seen: float
    covariance: SlipCovariance

    def corrected(self, measured_m: float, variance_m2: float, direction: float) -> SlipState:
        """Return the state after a reading; a stem that friction brakes does not turn."""
        p = self.covariance
        by = 1.0 / (p.yy + variance_m2)
        change = by * (measured_m - self.seen)
        x, v, f, y = p.xy * by, p.vy * by, p.fy * by, p.yy * by
        speed = self.v + p.vy * change
        return SlipState(
            self.x + p.xy * change,
            speed if direction * speed > 0.0 else 0.0,
            self.sliding_n + p.fy * change,
            self.seen + p.yy * change,
            SlipCovariance(
                p.xx - x * p.xy,
                p.xv - x * p.vy,
                p.xf - x * p.fy,
                p.xy - x * p.yy,
                p.vv - v * p.vy,
                p.vf - v * p.fy,
                p.vy - v * p.yy,
                p.ff - f * p.fy,
                p.fy - f * p.yy,
                p.yy - y * p.yy,
            ),
        )


def advanced(
    state: SlipState,
    slip: Slip,
    sensor: SensorLag,
    before: Pipeline,
    current_ma: float,
    force_noise_n: float,
    friction_n_per_m: float,
) -> tuple[SlipState, bool]:
    """Return the state one sample later, and whether the stem stopped in it.

    Args:
        state: the estimate before.
        slip: the motion, with the F_c of `state`.
        sensor: the lag of the readings.
        before: the pressure before the sample.
        current_ma: what acted on it in the sample.
        force_noise_n: force that the model does not know, white per sample.
        friction_n_per_m: how much F_c wanders per metre.
    """
    s, x, v, f = slip.direction, state.x, state.v, state.sliding_n
    pressure_ma, converter_ma = before.pressure_ma, before.converter_ma
    end = slip.after(x, v, pressure_ma, converter_ma, current_ma)
    by_x = slip.after(x + _SMALL_M, v, pressure_ma, converter_ma, current_ma)
    by_v = slip.after(x, v + s * _SMALL_M_PER_S, pressure_ma, converter_ma, current_ma)
    step_n = _SMALL_OF_FRICTION * f
    by_f = slip.with_sliding(f + step_n).after(x, v, pressure_ma, converter_ma, current_ma)
    ax, av, af = (by_x[0] - end[0]) / _SMALL_M, (by_v[0] - end[0]) / (s * _SMALL_M_PER_S), (by_f[0] - end[0]) / step_n
    bx, bv, bf = (by_x[1] - end[1]) / _SMALL_M, (by_v[1] - end[1]) / (s * _SMALL_M_PER_S), (by_f[1] - end[1]) / step_n
    if end[4]:
        bx, bv, bf = 0.0, 0.0, 0.0
    # y after = (1 - behind) x after + (behind - left) x before + left y before
    share, left = 1.0 - sensor.behind, sensor.left
    cx, cv, cf, cy = share * ax + sensor.behind - left, share * av, share * af, left
    p = state.covariance
    # covariance of the new x, v, y with every old state
    xx, xv = ax * p.xx + av * p.xv + af * p.xf, ax * p.xv + av * p.vv + af * p.vf
    xf, xy = ax * p.xf + av * p.vf + af * p.ff, ax * p.xy + av * p.vy + af * p.fy
    vx, vv = bx * p.xx + bv * p.xv + bf * p.xf, bx * p.xv + bv * p.vv + bf * p.vf
    vf, vy = bx * p.xf + bv * p.vf + bf * p.ff, bx * p.xy + bv * p.vy + bf * p.fy
    yx, yv = cx * p.xx + cv * p.xv + cf * p.xf + cy * p.xy, cx * p.xv + cv * p.vv + cf * p.vf + cy * p.vy
    yf, yy = cx * p.xf + cv * p.vf + cf * p.ff + cy * p.fy, cx * p.xy + cv * p.vy + cf * p.fy + cy * p.yy
    kick = 0.0
    if not end[4]:
        model, period_s = slip.model, slip.drive.period_s
        kick = force_noise_n * period_s / (model.mass_kg + period_s * model.viscous_n_s_per_m)
    wander_n = friction_n_per_m * friction_n_per_m * abs(end[0] - x)
    covariance = SlipCovariance(
        ax * xx + av * xv + af * xf,
        bx * xx + bv * xv + bf * xf,
        xf,
        cx * xx + cv * xv + cf * xf + cy * xy,
        bx * vx + bv * vv + bf * vf + kick * kick,
        vf,
        cx * vx + cv * vv + cf * vf + cy * vy,
        p.ff + wander_n,
        yf,
        cx * yx + cv * yv + cf * yf + cy * yy,
    )
    return SlipState(end[0], end[1], f, sensor.after(x, end[0], state.seen), covariance), end[4]
