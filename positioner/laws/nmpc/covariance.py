"""The covariance of position, speed, spring rate and friction of a sliding stem, entry by entry. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.valve.motion import Load, Transition


@dataclass(frozen=True, slots=True)
class Covariance:
    """The upper triangle of the covariance of x (m), v (m/s), K (N/m), F_c (N) and F_v (N s/m): k, f and c in names."""

    xx: float
    xv: float
    xk: float
    xf: float
    xc: float
    vv: float
    vk: float
    vf: float
    vc: float
    kk: float
    kf: float
    kc: float
    ff: float
    fc: float
    cc: float


def independent(position_m2: float, sigmas: Load) -> Covariance:
    """Return the covariance of a stem that rests, with independent errors of its position and of its load."""
    k, f, c = sigmas.spring_n_per_m, sigmas.friction_n, sigmas.viscous_n_s_per_m
    return Covariance(position_m2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, k * k, 0.0, 0.0, f * f, 0.0, c * c)


def propagated(
    p: Covariance, end: Transition, direction: float, speed_m2_per_s2: float, friction_n2: float
) -> Covariance:
    """Return J P J', where J has the derivatives of `end` for x and v; the load stays.

    F_c acts through the net push, against the move. The last two arguments are added to the variances of v, while the
    stem slides, and of F_c.
    """
    x, v, k, f, c = end.dx_dx, end.dx_dv, end.dx_dk, -direction * end.dx_dq, end.dx_dc
    # the covariance of the new x with every old state
    xx = x * p.xx + v * p.xv + k * p.xk + f * p.xf + c * p.xc
    xv = x * p.xv + v * p.vv + k * p.vk + f * p.vf + c * p.vc
    xk = x * p.xk + v * p.vk + k * p.kk + f * p.kf + c * p.kc
    xf = x * p.xf + v * p.vf + k * p.kf + f * p.ff + c * p.fc
    xc = x * p.xc + v * p.vc + k * p.kc + f * p.fc + c * p.cc
    new_xx = x * xx + v * xv + k * xk + f * xf + c * xc
    if end.stopped:
        return Covariance(new_xx, 0.0, xk, xf, xc, 0.0, 0.0, 0.0, 0.0, p.kk, p.kf, p.kc, p.ff + friction_n2, p.fc, p.cc)
    x, v, k, f, c = end.dv_dx, end.dv_dv, end.dv_dk, -direction * end.dv_dq, end.dv_dc
    new_xv = x * xx + v * xv + k * xk + f * xf + c * xc
    vx = x * p.xx + v * p.xv + k * p.xk + f * p.xf + c * p.xc
    vv = x * p.xv + v * p.vv + k * p.vk + f * p.vf + c * p.vc
    vk = x * p.xk + v * p.vk + k * p.kk + f * p.kf + c * p.kc
    vf = x * p.xf + v * p.vf + k * p.kf + f * p.ff + c * p.fc
    vc = x * p.xc + v * p.vc + k * p.kc + f * p.fc + c * p.cc
    new_vv = x * vx + v * vv + k * vk + f * vf + c * vc + speed_m2_per_s2
    return Covariance(new_xx, new_xv, xk, xf, xc, new_vv, vk, vf, vc, p.kk, p.kf, p.kc, p.ff + friction_n2, p.fc, p.cc)


def reduced(p: Covariance, by: float) -> Covariance:
    """Return P - `by`·pp', where p is the column of x: what knowledge of the position takes away."""
    x, v, k, f, c = p.xx * by, p.xv * by, p.xk * by, p.xf * by, p.xc * by
    return Covariance(
        p.xx - x * p.xx,
        p.xv - x * p.xv,
        p.xk - x * p.xk,
        p.xf - x * p.xf,
        p.xc - x * p.xc,
        p.vv - v * p.xv,
        p.vk - v * p.xk,
        p.vf - v * p.xf,
        p.vc - v * p.xc,
        p.kk - k * p.xk,
        p.kf - k * p.xf,
        p.kc - k * p.xc,
        p.ff - f * p.xf,
        p.fc - f * p.xc,
        p.cc - c * p.xc,
    )


def at_rest(p: Covariance, landing_m2: float) -> Covariance:
    """Return the covariance of a stem that has come to rest: no speed, and a position that is less certain."""
    return Covariance(p.xx + landing_m2, 0.0, p.xk, p.xf, p.xc, 0.0, 0.0, 0.0, 0.0, p.kk, p.kf, p.kc, p.ff, p.fc, p.cc)


def departing(p: Covariance, friction_n2: float) -> Covariance:
    """Return the covariance with `friction_n2` added to the variance of F_c."""
    return Covariance(
        p.xx, p.xv, p.xk, p.xf, p.xc, p.vv, p.vk, p.vf, p.vc, p.kk, p.kf, p.kc, p.ff + friction_n2, p.fc, p.cc
    )
