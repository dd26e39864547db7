"""What a stroke test expects of a healthy valve: jump, course, lag and limits, from the configured valve. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from positioner.commissioning.known import SMOOTHING_S
from positioner.commissioning.stroke.settings import Direction, StrokeSettings
from positioner.values import dataclass

if TYPE_CHECKING:
    from positioner.commissioning.procedure import ProcedureLimits
    from positioner.valve.parameters import ValveParameters

_SMOOTH_SPEEDS = 2.0
"""Above this many Stribeck velocities a stem slides steadily."""
_COAST_OF_STROKE = 0.4
_COAST_OF_TOLERANCE = 0.8
_COASTS = 4.0
_SIGMA = 6.0
_LEAST_OF_SPAN = 0.0012
_SEEN_OF_TOLERANCE = 0.25
"""The readings are smoothed until a motion of this part of the tolerance is more than their noise."""
_LONGEST_SMOOTHING_S = 0.2


@dataclass(frozen=True, slots=True)
class Plan:
    """The test from one place; distances are counted from the start in the direction of the stroke.

    way: +1 opening, -1 closing. rest_ma: the current in the middle of the stick band at the start; ma_per_m: its change
    with the place, K/B.
    static_ma: the configured static friction as a current. jump_m: the natural jump, (F_s - F_c)/K.
    stroke_m: the wanted stroke; aim_m: the one to expect, the jump where that is longer; furthest_m: the limit.
    tolerance_m: from the course. rate_ma_per_s, speed_m_per_s: of the stem that slides.
    lag_s: from the current to the sliding stem; slow_s: what it may take in addition.
    smoothing_s: time constant of the smoothed reading; seen_m: the motion that is more than its noise; sigma_m: the
    noise of a reading.
    """

    start_m: float
    way: float
    rest_ma: float
    ma_per_m: float
    static_ma: float
    jump_m: float
    stroke_m: float
    aim_m: float
    furthest_m: float
    tolerance_m: float
    rate_ma_per_s: float
    speed_m_per_s: float
    lag_s: float
    slow_s: float
    smoothing_s: float
    seen_m: float
    sigma_m: float

    @property
    def coast_from_m(self) -> float:
        """Where the smoothed reading is when the current is to be held, to end at the end of the stroke."""
        return self.aim_m - self.speed_m_per_s * self.lag_s - self.late_m

    @property
    def late_m(self) -> float:
        """How far in m the smoothed reading is behind a stem that slides."""
        return self.speed_m_per_s * self.smoothing_s

    @property
    def coast_s(self) -> float:
        """For how long the current is then held, in s."""
        return _COASTS * (self.slow_s + self.lag_s)

    @property
    def coast_to_m(self) -> float:
        """Where a stem is stopped that coasts farther than a valve can that is not slow."""
        coasts_m = self.speed_m_per_s * self.slow_s + self.seen_m
        return self.aim_m + min(coasts_m, _COAST_OF_TOLERANCE * self.tolerance_m)

    def balance_ma(self, position_m: float) -> float:
        """Return the current in mA in the middle of the stick band at a place in m."""
        return self.rest_ma + self.ma_per_m * (position_m - self.start_m)

    def gone_m(self, position_m: float) -> float:
        """Return the distance from the start in m."""
        return self.way * (position_m - self.start_m)


def plan_of(
    valve: ValveParameters,
    limits: ProcedureLimits,
    settings: StrokeSettings,
    period_s: float,
    start_m: float,
    sigma_m: float,
) -> Plan:
    """Return the plan of a test from a place in m; `sigma_m` is the noise of a reading."""
    gain, spring = valve.force_gain_n_per_ma, valve.spring_rate_n_per_m
    m_per_ma, stroke_m = gain / spring, settings.stroke_of_span * limits.span_m
    lag_s = valve.lag_s
    slides_ma_per_s = _SMOOTH_SPEEDS * valve.stribeck_velocity_m_per_s / m_per_ma
    jump_m = (valve.static_friction_n - valve.coulomb_friction_n) / spring
    aim_m = max(stroke_m, jump_m)
    fastest = _COAST_OF_STROKE * aim_m / max(lag_s, period_s) / m_per_ma
    rate = min(max(settings.rate_ma_per_s, slides_ma_per_s), fastest, limits.rate_ma_per_s)
    tolerance_m = settings.tolerance_of_span * limits.span_m
    ratio = _SIGMA * sigma_m / (_SEEN_OF_TOLERANCE * tolerance_m)
    smoothing_s = min(max(0.5 * period_s * (ratio * ratio - 1.0), SMOOTHING_S), _LONGEST_SMOOTHING_S)
    left = math.sqrt(period_s / (2.0 * smoothing_s + period_s))
    return Plan(
        start_m=start_m,
        way=-1.0 if settings.direction is Direction.CLOSING else 1.0,
        rest_ma=valve.balance_current_ma(start_m),
        ma_per_m=1.0 / m_per_ma,
        static_ma=valve.static_friction_n / gain,
        jump_m=jump_m,
        stroke_m=stroke_m,
        aim_m=aim_m,
        furthest_m=aim_m + tolerance_m,
        tolerance_m=tolerance_m,
        rate_ma_per_s=rate,
        speed_m_per_s=rate * m_per_ma,
        lag_s=lag_s,
        slow_s=settings.slow_s,
        smoothing_s=smoothing_s,
        seen_m=max(_SIGMA * sigma_m * left, _LEAST_OF_SPAN * limits.span_m),
        sigma_m=sigma_m,
    )


def places_m(valve: ValveParameters, limits: ProcedureLimits, plan: Plan) -> tuple[float, float]:
    """Return from where to where in m the currents can do the stroke; the first is above the second if nowhere.

    Both ends of the stroke lie within the travel and within the reach of a sliding stem; the current frees the stem at
    the start for the way out, and at the end for the way back.
    """
    low_m, high_m = valve.reach_m(limits.current_low_ma, limits.current_high_ma)
    free_low_m, free_high_m = valve.restartable_m(limits.current_low_ma, limits.current_high_ma)
    way_m = plan.way * plan.aim_m
    least_m, most_m = low_m - min(way_m, 0.0), high_m - max(way_m, 0.0)
    if plan.way < 0.0:
        return max(least_m, free_low_m), min(most_m, free_high_m - way_m)
    return max(least_m, free_low_m - way_m), min(most_m, free_high_m)


def place_near_m(valve: ValveParameters, limits: ProcedureLimits, plan: Plan) -> float | None:
    """Return the nearest place in m from which the stroke is possible, with a tolerance to spare; None if nowhere."""
    low_m, high_m = places_m(valve, limits, plan)
    if low_m > high_m:
        return None
    margin_m = min(plan.tolerance_m, 0.5 * (high_m - low_m))
    return min(max(plan.start_m, low_m + margin_m), high_m - margin_m)
