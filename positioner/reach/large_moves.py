"""How long one move lasts: the shortest time, with everything known, and the law's, which must see a slip. Pure.

The shortest: all current in one direction, then all in the other, so that the stem stops at its target. The law's: to
the foot of its ramp, up the ramp until the stem slips, on until the readings show it, and then as fast as the predicted
stop allows. Without lag the law pushes at once, and answers a new setpoint one period later.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.laws.nmpc.lagged.detectable import detectable_jump
from positioner.laws.nmpc.lagged.valve import is_lagged
from positioner.reach.case import brake_ma, freeing_ma, slip_of

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.valve import LaggedValve
    from positioner.reach.case import Case

SETTLED_OF_SPAN = 0.01
_SHORTEST_STEP_S, _STEPS_OF_LAG = 2.5e-4, 1000.0
_HALVINGS = 16
_LONGEST_S = 60.0
_NOTICED = 3.5
_FOOT = 0.9
"""Where the ramp begins, as a part of F_s, once F_s is known to 5 %."""
_REACH, _SPARE = 0.6, 1.15
_MULTIPLES = (256.0, 64.0, 16.0, 4.0, 2.0)
"""As in the law's plan: the ramps that are tried, and the part of the error that their jump may be."""


@dataclass(frozen=True, slots=True)
class Durations:
    """Until the stem is within 1 % of span of its target and stays there, in s: the shortest, and the law's."""

    shortest_s: float
    law_s: float


def durations(case: Case, move_m: float, slowest_ma_per_s: float) -> Durations:
    """Return the durations of an opening by `move_m` around the middle; infinity where the current is too weak.

    `slowest_ma_per_s` is the slowest ramp of the law.
    """
    shortest_s = _shortest_s(case, case.middle_m - move_m / 2.0, move_m)
    if not is_lagged(case.valve):
        return Durations(shortest_s, shortest_s + case.period_s)
    near_m = SETTLED_OF_SPAN * case.valve.span_m
    return Durations(shortest_s, max(of_the_law_s(case, move_m, slowest_ma_per_s, near_m), shortest_s))


def _shortest_s(case: Case, start_m: float, move_m: float) -> float:
    lag_s = max(case.valve.actuator.fill_time_constant_s, case.valve.actuator.converter_time_constant_s)
    own = case.lagged(max(_SHORTEST_STEP_S, lag_s / _STEPS_OF_LAG))
    low_s, high_s = 0.0, own.period_s
    while _thrown(case, own, start_m, start_m + move_m, high_s)[0] < start_m + move_m:
        low_s, high_s = high_s, 2.0 * high_s
        if high_s > _LONGEST_S:
            return math.inf
    for _ in range(_HALVINGS):
        middle_s = (low_s + high_s) / 2.0
        if _thrown(case, own, start_m, start_m + move_m, middle_s)[0] < start_m + move_m:
            low_s = middle_s
        else:
            high_s = middle_s
    return own.dead_time_s + _thrown(case, own, start_m, start_m + move_m, high_s)[1]


def _thrown(case: Case, own: LaggedValve, x: float, target_m: float, until_s: float) -> tuple[float, float]:
    """Return where a stem stops that is pushed `until_s` and then braked with all current, and when it settles."""
    slip, drive, near_m = slip_of(own, 1.0), own.drive, SETTLED_OF_SPAN * case.valve.span_m
    pressure_ma = converter_ma = own.model.pressure_ma(own.spring_n_per_m * x)
    v, t, settled_s, is_free, stopped = 0.0, 0.0, 0.0, False, False
    while not stopped and t < _LONGEST_S:
        # the sample in which the current changes is shared by both
        share = min(max((until_s - t) / own.period_s, 0.0), 1.0)
        current_ma = share * case.high_ma + (1.0 - share) * case.low_ma
        is_free = is_free or own.model.net_n(pressure_ma, own.spring_n_per_m, x) > own.static_n
        if is_free:
            x, v, pressure_ma, converter_ma, stopped = slip.after(x, v, pressure_ma, converter_ma, current_ma)
        else:
            pressure_ma, converter_ma = drive.after(pressure_ma, converter_ma, current_ma)
            stopped = t > until_s
        t += own.period_s
        if abs(x - target_m) > near_m:
            settled_s = t
    return x, settled_s


def of_the_law_s(case: Case, move_m: float, slowest_ma_per_s: float, near_m: float) -> float:
    """Return how long the law takes behind a lag until an opening by `move_m` is within `near_m` of its target."""
    start_m = case.middle_m - move_m / 2.0
    own, target_m = case.lagged(), start_m + move_m
    slip, drive, sigma_m, x = slip_of(own, 1.0), own.drive, case.sigma_m, start_m
    rate = slowest_ma_per_s
    for multiple in _MULTIPLES:
        jump_m, _ = detectable_jump(
            slip, own.sensor, x, multiple * rate, own.delay_samples, sigma_m, case.settings.lagged.brake_share
        )
        if _SPARE * jump_m < _REACH * move_m:
            rate *= multiple
            break
    pressure_ma = converter_ma = before_ma = own.model.pressure_ma(own.spring_n_per_m * x)
    foot_ma = own.model.pressure_ma(own.spring_n_per_m * x + _FOOT * own.static_n)
    t = own.dead_time_s
    free_ma = freeing_ma(slip, x)
    while pressure_ma < free_ma:
        aim_ma = foot_ma if pressure_ma < foot_ma - _AT_FOOT_MA else pressure_ma + rate * own.period_s
        current_ma = drive.command_ma(pressure_ma, converter_ma, aim_ma)
        before_ma, (pressure_ma, converter_ma) = pressure_ma, drive.after(pressure_ma, converter_ma, current_ma)
        t += own.period_s
        if t > _LONGEST_S:
            return math.inf
    # the slip begins within the last sample
    t -= own.period_s * (pressure_ma - free_ma) / (pressure_ma - before_ma)
    pressure_ma = free_ma
    v, evidence, seen, wait, settled_s, stopped = 0.0, 0.0, x, own.delay_samples, 0.0, False
    cruise_n = own.sliding_n + own.model.viscous_n_s_per_m * case.settings.lagged.fastest_m_per_s
    stop_ma = brake_ma(case, slip, target_m)
    while not stopped and t < _LONGEST_S:
        if evidence < _NOTICED or wait > 0:
            current_ma, _ = drive.ramp_ma(pressure_ma, 1.0, rate)
            wait -= 1 if evidence >= _NOTICED else 0
        else:
            cruise_ma = own.model.pressure_ma(own.spring_n_per_m * x + cruise_n)
            current_ma = drive.command_ma(pressure_ma, converter_ma, cruise_ma)
            if slip.stop_m(x, v, pressure_ma, converter_ma, current_ma, stop_ma) > target_m:
                current_ma = drive.command_ma(pressure_ma, converter_ma, stop_ma)
        before = x
        x, v, pressure_ma, converter_ma, stopped = slip.after(x, v, pressure_ma, converter_ma, current_ma)
        seen = own.sensor.after(before, x, seen)
        evidence += (seen - start_m) * (seen - start_m) / (2.0 * sigma_m * sigma_m)
        t += own.period_s
        if abs(x - target_m) > near_m:
            settled_s = t
    return settled_s


_AT_FOOT_MA = 1e-3
