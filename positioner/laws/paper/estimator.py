"""Position and speed of the stem from noisy positions: a Kalman filter with stick logic, or raw. Pure.

While the stem slides, the model is the closed form of `valve.motion`, in which friction can stop the stem inside a
sample. While the stem sticks, the speed and its variance are zero, and the filter is a plain average. The stick ends
when the current overcomes spring and friction in the model, or when the innovations show that the stem has slipped
although it sticks in the model.

The method "raw" takes the paper literally: each reading is the position, and its difference quotient the speed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.laws.estimator_settings import EstimationMethod, measurement_sigma_m
from positioner.values import dataclass, replace
from positioner.valve.motion import Load, MotionModel
from positioner.valve.state import StemState

if TYPE_CHECKING:
    from positioner.laws.estimator_settings import EstimatorSettings
    from positioner.valve.parameters import ValveParameters


_SPEED_AT_SURPRISE_M_PER_S = 0.3
"""σ of the speed after a slip that the model has not foreseen: the peak speed of the natural slip jump."""


@dataclass(frozen=True, slots=True)
class FilteredStem(StemState):
    """A stem with the covariance of x and v in SI units, and the smoothed innovation in σ while it sticks."""

    p_xx: float
    p_xv: float = 0.0
    p_vv: float = 0.0
    drift: float = 0.0

    @property
    def position_sigma_m(self) -> float:
        """Standard deviation of the position in m."""
        return math.sqrt(max(self.p_xx, 0.0))


def first_estimate(settings: EstimatorSettings, valve: ValveParameters, measured_m: float) -> FilteredStem:
    """Return the estimate from a single reading: at rest where it was measured."""
    sigma = measurement_sigma_m(settings, valve, measured_m)
    return FilteredStem(measured_m, 0.0, stuck=valve.static_friction_n > 0.0, direction=1.0, p_xx=sigma * sigma)


def estimate(
    settings: EstimatorSettings,
    valve: ValveParameters,
    state: FilteredStem,
    measured_m: float,
    applied_ma: float,
    period_s: float,
) -> FilteredStem:
    """Return the estimate after `period_s` under `applied_ma`, corrected by the reading `measured_m`."""
    if settings.method is EstimationMethod.RAW:
        return _differentiate(settings, valve, state, measured_m, period_s)
    return _correct(settings, valve, _predict(settings, valve, state, applied_ma, period_s), measured_m, applied_ma)


def _differentiate(
    settings: EstimatorSettings, valve: ValveParameters, state: FilteredStem, measured_m: float, period_s: float
) -> FilteredStem:
    """Return the reading and its difference quotient; below DV, in Karnopp's band, a stem with friction sticks."""
    velocity = (measured_m - state.position_m) / period_s
    sigma = measurement_sigma_m(settings, valve, measured_m)
    variance = sigma * sigma
    if valve.static_friction_n > 0.0 and abs(velocity) < valve.stick_velocity_m_per_s:
        return _stuck(measured_m, state.direction, variance)
    direction = math.copysign(1.0, velocity) if velocity else state.direction
    # the difference of two readings, each with this variance
    p_xv, p_vv = variance / period_s, 2.0 * variance / (period_s * period_s)
    return FilteredStem(measured_m, velocity, stuck=False, direction=direction, p_xx=variance, p_xv=p_xv, p_vv=p_vv)


def _predict(
    settings: EstimatorSettings, valve: ValveParameters, state: FilteredStem, applied_ma: float, period_s: float
) -> FilteredStem:
    push_n = valve.net_force_n(state.position_m, applied_ma)
    if state.stuck:
        if _holds(valve, state.position_m, applied_ma):
            return state
        state = replace(state, stuck=False, direction=math.copysign(1.0, push_n), drift=0.0)
    direction = state.direction if state.velocity_m_per_s else math.copysign(1.0, push_n)
    model, load = MotionModel.of(valve), Load.of(valve)
    end = model.step(state.position_m, state.velocity_m_per_s, applied_ma, load, direction, period_s)
    a, b, c, d = end.dx_dx, end.dx_dv, end.dv_dx, end.dv_dv
    p_xx = a * a * state.p_xx + 2.0 * a * b * state.p_xv + b * b * state.p_vv
    p_xv = a * c * state.p_xx + (a * d + b * c) * state.p_xv + b * d * state.p_vv
    p_vv = c * c * state.p_xx + 2.0 * c * d * state.p_xv + d * d * state.p_vv
    resting = end.stopped or abs(end.v) < valve.stick_velocity_m_per_s
    if resting and _holds(valve, end.x, applied_ma):
        return _stuck(end.x, direction, p_xx)
    if end.stopped:
        # the stem turns round here: it has no speed, but is not stuck
        return FilteredStem(end.x, 0.0, stuck=False, direction=-direction, p_xx=p_xx, p_vv=p_vv)
    kick = settings.force_noise_n / valve.mass_kg * period_s
    p_vv += kick * kick
    return FilteredStem(end.x, end.v, stuck=False, direction=direction, p_xx=p_xx, p_xv=p_xv, p_vv=p_vv)


def _stuck(position_m: float, direction: float, variance_m2: float, drift: float = 0.0) -> FilteredStem:
    return FilteredStem(position_m, 0.0, stuck=True, direction=direction, p_xx=variance_m2, drift=drift)


def _holds(valve: ValveParameters, position_m: float, applied_ma: float) -> bool:
    """Return whether static friction holds a resting stem; a valve without it never sticks, not even in balance."""
    return 0.0 < valve.static_friction_n >= abs(valve.net_force_n(position_m, applied_ma))


def _correct(
    settings: EstimatorSettings, valve: ValveParameters, state: FilteredStem, measured_m: float, applied_ma: float
) -> FilteredStem:
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
            return _stuck(position, state.direction, p_xx, drift)
        # the stem has slipped, and the model has not foreseen it: take the reading, and any speed is possible
        direction, p_vv = math.copysign(1.0, drift), _SPEED_AT_SURPRISE_M_PER_S * _SPEED_AT_SURPRISE_M_PER_S
        return FilteredStem(measured_m, 0.0, stuck=False, direction=direction, p_xx=sigma * sigma, p_vv=p_vv)
    velocity = state.velocity_m_per_s + gain_v * innovation
    p_xv, p_vv = (1.0 - gain_x) * state.p_xv, state.p_vv - gain_v * state.p_xv
    if valve.static_friction_n > 0.0 and state.velocity_m_per_s:
        forward = velocity * state.direction
        if forward < valve.stick_velocity_m_per_s and _holds(valve, position, applied_ma):
            return _stuck(position, state.direction, p_xx)
        if forward <= 0.0:
            # friction stops the stem before its speed can change sign, although it cannot hold the stem here
            return FilteredStem(position, 0.0, stuck=False, direction=state.direction, p_xx=p_xx, p_vv=p_vv)
    direction = math.copysign(1.0, velocity) if velocity else state.direction
    return FilteredStem(position, velocity, stuck=False, direction=direction, p_xx=p_xx, p_xv=p_xv, p_vv=p_vv)
