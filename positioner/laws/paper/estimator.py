"""Position and speed of the stem from noisy positions: a Kalman filter with stick logic, or nothing at all. Pure.

While the stem slides, the model is the closed form of `valve.motion`, which stops the stem inside a sample when its
speed runs out. While it sticks, speed and its variance are zero and nothing drives the covariance: the filter becomes
a plain average. It leaves the stick when the model says the spring loses to the current, or when the innovations say
that the stem has left without the model's consent.

The method "raw" is the paper read literally: each reading is the position, and its difference quotient the speed.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.laws.estimator_settings import EstimationMethod, measurement_sigma_m
from positioner.valve.motion import Load, MotionModel
from positioner.valve.state import StemState

if TYPE_CHECKING:
    from positioner.laws.estimator_settings import EstimatorSettings
    from positioner.valve.parameters import ValveParameters


_SPEED_AT_SURPRISE_M_PER_S = 0.3
"""σ of the speed after a slip that the model did not foresee: the peak speed of the natural slip jump."""


def first_estimate(settings: EstimatorSettings, valve: ValveParameters, measured_m: float) -> StemState:
    """Return the estimate from a single reading: at rest where it was measured."""
    sigma = measurement_sigma_m(settings, valve, measured_m)
    return StemState(measured_m, 0.0, valve.static_friction_n > 0.0, 1.0, sigma * sigma, 0.0, 0.0)


def estimate(
    settings: EstimatorSettings,
    valve: ValveParameters,
    state: StemState,
    measured_m: float,
    applied_ma: float,
    period_s: float,
) -> StemState:
    """Return the estimate after `period_s` under `applied_ma`, corrected by the reading `measured_m`."""
    if settings.method is EstimationMethod.RAW:
        return _differentiate(settings, valve, state, measured_m, period_s)
    return _correct(settings, valve, _predict(settings, valve, state, applied_ma, period_s), measured_m, applied_ma)


def _differentiate(
    settings: EstimatorSettings, valve: ValveParameters, state: StemState, measured_m: float, period_s: float
) -> StemState:
    """Return the reading and its difference quotient; below DV, in Karnopp's band, a stem with friction sticks."""
    velocity = (measured_m - state.position_m) / period_s
    variance = measurement_sigma_m(settings, valve, measured_m) ** 2
    if valve.static_friction_n > 0.0 and abs(velocity) < valve.stick_velocity_m_per_s:
        return StemState(measured_m, 0.0, True, state.direction, variance, 0.0, 0.0)
    direction = math.copysign(1.0, velocity) if velocity else state.direction
    # the difference of two readings, each with this variance
    covariance, speed_variance = variance / period_s, 2.0 * variance / period_s**2
    return StemState(measured_m, velocity, False, direction, variance, covariance, speed_variance)


def _predict(
    settings: EstimatorSettings, valve: ValveParameters, state: StemState, applied_ma: float, period_s: float
) -> StemState:
    push_n = valve.net_force_n(state.position_m, applied_ma)
    if state.stuck:
        if _holds(valve, state.position_m, applied_ma):
            return state
        state = replace(state, stuck=False, direction=math.copysign(1.0, push_n), drift=0.0)
    direction = state.direction if state.velocity_m_per_s else math.copysign(1.0, push_n)
    model, load = MotionModel.of(valve), Load.of(valve)
    motion = model.step(state.position_m, state.velocity_m_per_s, applied_ma, load, direction, period_s)
    a, b, c, d = motion.dx_dx, motion.dx_dv, motion.dv_dx, motion.dv_dv
    p_xx = a * a * state.p_xx + 2.0 * a * b * state.p_xv + b * b * state.p_vv
    p_xv = a * c * state.p_xx + (a * d + b * c) * state.p_xv + b * d * state.p_vv
    p_vv = c * c * state.p_xx + 2.0 * c * d * state.p_xv + d * d * state.p_vv
    resting = motion.stopped or abs(motion.v) < valve.stick_velocity_m_per_s
    if resting and _holds(valve, motion.x, applied_ma):
        return StemState(motion.x, 0.0, True, direction, p_xx, 0.0, 0.0)
    if motion.stopped:
        # the stem only turns round here: it has no speed, and is not stuck
        return StemState(motion.x, 0.0, False, -direction, p_xx, 0.0, p_vv)
    kick = settings.force_noise_n / valve.mass_kg * period_s
    return StemState(motion.x, motion.v, False, direction, p_xx, p_xv, p_vv + kick * kick)


def _holds(valve: ValveParameters, position_m: float, applied_ma: float) -> bool:
    """Return whether static friction holds a resting stem; a valve without it never sticks, not even in balance."""
    return 0.0 < valve.static_friction_n >= abs(valve.net_force_n(position_m, applied_ma))


def _correct(
    settings: EstimatorSettings, valve: ValveParameters, state: StemState, measured_m: float, applied_ma: float
) -> StemState:
    sigma = measurement_sigma_m(settings, valve, state.position_m)
    variance = state.p_xx + sigma * sigma
    innovation = measured_m - state.position_m
    gain_x, gain_v = state.p_xx / variance, state.p_xv / variance
    position = state.position_m + gain_x * innovation
    p_xx = (1.0 - gain_x) * state.p_xx
    if state.stuck:
        weight = settings.slip_smoothing
        drift = state.drift + weight * (innovation / math.sqrt(variance) - state.drift)
        if abs(drift) <= settings.slip_threshold_sigma * math.sqrt(weight / (2.0 - weight)):
            return StemState(position, 0.0, True, state.direction, p_xx, 0.0, 0.0, drift)
        # the stem has left without the model's consent: believe the reading, keep the speed open
        speed_variance = _SPEED_AT_SURPRISE_M_PER_S**2
        return StemState(measured_m, 0.0, False, math.copysign(1.0, drift), sigma * sigma, 0.0, speed_variance)
    velocity = state.velocity_m_per_s + gain_v * innovation
    p_xv, p_vv = (1.0 - gain_x) * state.p_xv, state.p_vv - gain_v * state.p_xv
    if valve.static_friction_n > 0.0 and state.velocity_m_per_s:
        forward = velocity * state.direction
        if forward < valve.stick_velocity_m_per_s and _holds(valve, position, applied_ma):
            return StemState(position, 0.0, True, state.direction, p_xx, 0.0, 0.0)
        if forward <= 0.0:
            # friction stops the stem before its speed can change sign, though it cannot hold it here
            return StemState(position, 0.0, False, state.direction, p_xx, 0.0, p_vv)
    direction = math.copysign(1.0, velocity) if velocity else state.direction
    return StemState(position, velocity, False, direction, p_xx, p_xv, p_vv)
