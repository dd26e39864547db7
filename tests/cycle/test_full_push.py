"""A push with all the current that moves nothing: told from a stroke, a lag, another place, and a jammed stem."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from positioner.cycle.full_push import NO_PUSH, OFF, FullPush, may_hold, track_push
from positioner.guard.settings import GuardSettings
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters

SETTINGS = GuardSettings()
VALVE = ValveParameters(id="paper")
LAGGED = replace(VALVE, actuator=ActuatorParameters(fill_time_constant_s=0.1, vent_time_constant_s=0.2))
HERE_M, PROGRESS_M = 0.08, 0.00127
GAIN, RATE, STATIC = VALVE.force_gain_n_per_ma, VALVE.spring_rate_n_per_m, VALVE.static_friction_n


def pushed(
    seconds: float,
    sent_ma: float = 20.0,
    direction: int = 1,
    known: FullPush = NO_PUSH,
    place_m: float = HERE_M,
    valve: ValveParameters = VALVE,
) -> FullPush:
    for _ in range(round(seconds / 1e-3)):
        known = track_push(SETTINGS, valve, known, place_m, direction, PROGRESS_M, sent_ma, 1e-3)
    return known


def test_a_stem_that_all_the_current_does_not_move_for_long_enough_is_held() -> None:
    assert not pushed(0.295).is_in_vain
    assert pushed(0.305).is_in_vain
    assert pushed(0.305, 4.0, -1, place_m=0.07).is_in_vain


@pytest.mark.parametrize(("sent_ma", "direction"), [(19.6, 1), (20.0, -1), (20.0, 0), (4.0, 1), (4.4, -1)])
def test_a_weaker_current_or_one_the_other_way_is_no_full_push(sent_ma: float, direction: int) -> None:
    assert pushed(2.0, sent_ma, direction, place_m=0.075).seconds == 0.0


def test_progress_begins_the_time_again_and_a_little_less_does_not() -> None:
    known = pushed(0.4)
    less_m, enough_m = HERE_M + 0.999 * PROGRESS_M, HERE_M + 1.001 * PROGRESS_M
    assert pushed(1e-3, known=known, place_m=less_m).is_in_vain
    begun_again = pushed(1e-3, known=known, place_m=enough_m)
    assert (begun_again.seconds, begun_again.from_m) == (0.0, enough_m)
    assert pushed(1e-3, known=known, place_m=HERE_M - 0.02).is_in_vain


def test_what_is_known_after_progress_of_just_enough_and_after_another_direction() -> None:
    begun = pushed(1e-3)
    assert begun == FullPush(20.0, 1, HERE_M, was_full=True)
    assert pushed(1e-3, 12.0) == FullPush(12.0, 1, HERE_M, was_full=False)
    known = FullPush(20.0, 1, 0.0, seconds=0.4, was_full=True)
    assert pushed(1e-3, known=known, place_m=PROGRESS_M) == FullPush(20.0, 1, PROGRESS_M, was_full=True)
    lagged = pushed(1e-3, known=FullPush(16.0, 1, 0.0), place_m=PROGRESS_M, valve=LAGGED)
    assert lagged.current_ma == pytest.approx(20.0 - 4.0 * math.exp(-0.01))


def test_a_current_counts_as_full_within_just_that_part_of_the_range() -> None:
    narrow = replace(SETTINGS, current_high_ma=16.5)  # 2 % of 12.5 mA are 0.25 mA
    place_m = 16.5 * GAIN / RATE
    for sent_ma, is_full in ((16.25, True), (16.24, False)):
        assert track_push(narrow, VALVE, NO_PUSH, place_m, 1, PROGRESS_M, sent_ma, 1e-3).was_full is is_full


def test_a_setpoint_on_the_other_side_begins_anew() -> None:
    known = pushed(0.4)
    assert pushed(1e-3, 20.0, -1, known=known).seconds == 0.0
    assert pushed(1e-3, 20.0, 0, known=known).seconds == 0.0


def test_a_current_counts_when_it_has_arrived_behind_the_lag() -> None:
    # from 16 mA to within 2 % of 16 mA: τ ln(4/0.32) = 0.253 s
    start = FullPush(16.0, 1, HERE_M)
    assert pushed(0.250, known=start, valve=LAGGED).seconds == 0.0
    arrived = pushed(0.350, known=start, valve=LAGGED)
    assert arrived.current_ma == pytest.approx(20.0 - 4.0 * math.exp(-3.5))
    assert arrived.seconds == pytest.approx(0.097, abs=0.003)
    vented = pushed(0.2, 4.0, -1, known=FullPush(8.0, -1, HERE_M), valve=LAGGED)
    assert vented.current_ma == pytest.approx(4.0 + 4.0 * math.exp(-1.0))


def test_the_lag_of_the_converter_comes_on_top() -> None:
    actuator = replace(LAGGED.actuator, converter_time_constant_s=0.05)
    arrived = pushed(0.3, known=FullPush(16.0, 1, HERE_M), valve=replace(VALVE, actuator=actuator))
    assert arrived.current_ma == pytest.approx(20.0 - 4.0 * math.exp(-2.0))


def test_pushes_that_a_law_counts_as_failed_count_if_they_were_full() -> None:
    weak = pushed(0.01, 19.0).after_failed(5, HERE_M)
    assert weak.failed == 0
    once = pushed(0.01).after_failed(1, HERE_M)
    assert once.current_ma == 20.0
    assert not once.is_in_vain
    assert not once.was_full
    assert pushed(0.01, 19.0, known=once).after_failed(2, HERE_M).failed == 1
    assert pushed(0.01, known=once).after_failed(2, HERE_M).is_in_vain


def test_a_mean_that_follows_the_stem_to_the_place_of_the_failed_push_is_no_progress() -> None:
    late = pushed(0.01, place_m=0.075).after_failed(3, HERE_M)
    assert pushed(0.01, 16.0, known=late).is_in_vain
    assert not pushed(0.01, 16.0, known=late, place_m=HERE_M + 2.0 * PROGRESS_M).is_in_vain
    closing = pushed(0.01, 4.0, -1, place_m=0.075).after_failed(3, 0.07)
    assert pushed(0.01, 8.0, -1, known=closing, place_m=0.07).is_in_vain


def test_before_the_first_command_nothing_is_pushed() -> None:
    assert track_push(SETTINGS, VALVE, pushed(0.4), HERE_M, 1, PROGRESS_M, None, 1e-3) is NO_PUSH


def test_a_valve_within_three_tenths_of_the_configured_one_may_hold_the_stem_and_others_may_not() -> None:
    # 1.3 K x + F_s = 20 mA B, or K x + 1.3 F_s = 20 mA B: the nearer place
    by_spring = (20.0 * GAIN - STATIC) / (1.3 * RATE)
    by_friction = (20.0 * GAIN - 1.3 * STATIC) / RATE
    border_m = min(by_spring, by_friction)
    assert may_hold(VALVE, border_m + 1e-6, 1, 20.0)
    assert not may_hold(VALVE, border_m - 1e-6, 1, 20.0)
    border_m = max((4.0 * GAIN + STATIC) * 1.3 / RATE, (4.0 * GAIN + 1.3 * STATIC) / RATE)
    assert may_hold(VALVE, border_m - 1e-6, -1, 4.0)
    assert not may_hold(VALVE, border_m + 1e-6, -1, 4.0)
    assert not may_hold(VALVE, 0.027, 1, 20.0)  # where a stem without air rests


def test_a_valve_of_which_the_spring_or_the_friction_is_off_by_just_so_much_may_hold_the_stem() -> None:
    push_n = 20.0 * GAIN
    bench_set_n = 0.6 * push_n
    by_spring = replace(VALVE, bench_set_n=bench_set_n, static_friction_n=push_n - bench_set_n * OFF)
    assert may_hold(by_spring, 0.0, 1, 20.0)
    assert not may_hold(by_spring, -1e-6, 1, 20.0)
    by_friction = replace(VALVE, static_friction_n=push_n / OFF)
    assert push_n == by_friction.static_friction_n * OFF
    assert may_hold(by_friction, 0.0, 1, 20.0)
    assert not may_hold(by_friction, -1e-6, 1, 20.0)
