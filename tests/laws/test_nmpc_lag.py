"""The lag that one move shows, against a stem that follows its balance, integrated step by step."""

from __future__ import annotations

import math
import random

import pytest
from loop_helpers import Loop

from positioner.laws.nmpc.lag import Way
from positioner.wire.messages import Cause, Health, HostRequest, Mode

SPRING_MA_PER_M, STEP_S = 157.0, 1e-4
LAGS = {"fill_time_constant_s": 0.1, "vent_time_constant_s": 0.1}


def played(
    lag_s: float, lasted_s: float, gap_ma: float, step_ma: float = 10.0, jump_ma: float = 0.9
) -> tuple[Way, float]:
    """Return a move and its area: the stem sticks until `gap_ma` is left, slips, and follows its balance."""
    gap_now_ma, x, places_m, slides = step_ma, 0.0, list[float](), False
    for _ in range(round(lasted_s / STEP_S)):
        gap_now_ma -= gap_now_ma * STEP_S / lag_s
        slides = slides or gap_now_ma < gap_ma
        if slides:
            x = (gap_ma + jump_ma - gap_now_ma) / SPRING_MA_PER_M
        places_m.append(x)
    area_m_s = sum(x - place_m for place_m in places_m) * STEP_S
    return Way(step_ma, gap_ma, SPRING_MA_PER_M, x, lasted_s), area_m_s


@pytest.mark.parametrize("lag_s", [0.005, 0.05, 0.3])
@pytest.mark.parametrize("lags", [2.0, 4.0, 10.0])
@pytest.mark.parametrize("gap_ma", [9.0, 5.0, 2.0])
def test_the_area_shows_the_lag_also_of_a_move_that_has_not_ended(lag_s: float, lags: float, gap_ma: float) -> None:
    way, area_m_s = played(lag_s, lags * lag_s, gap_ma)
    assert way.area_m_s(lag_s) == pytest.approx(area_m_s, rel=0.05)
    assert way.lag_s(area_m_s) == pytest.approx(lag_s, rel=0.12)


def test_the_area_grows_with_the_lag_and_what_is_left_of_the_step_too() -> None:
    way = Way(10.0, 5.0, SPRING_MA_PER_M, 0.04, 1.0)
    areas_m_s = [way.area_m_s(0.01 * number) for number in range(40)]
    assert areas_m_s == sorted(areas_m_s)
    assert areas_m_s[0] == 0.0
    left_ma = [way.after_ma(0.01 * number) for number in range(40)]
    assert left_ma == sorted(left_ma)
    assert way.after_ma(0.25) == pytest.approx(10.0 * math.exp(-4.0))


def test_noise_of_the_readings_averages_out() -> None:
    way, area_m_s = played(0.1, 0.5, 5.0)
    chance = random.Random(1)  # noqa: S311 - to be repeated, no secret
    found_s = [way.lag_s(area_m_s + sum(chance.gauss(0.0, 1.6e-3) for _ in range(500)) * 1e-3) for _ in range(50)]
    assert max(abs(each - 0.1) for each in found_s) < 0.01


def test_a_lag_is_at_most_as_long_as_the_move() -> None:
    assert Way(10.0, 5.0, SPRING_MA_PER_M, 0.04, 0.2).lag_s(1.0) == pytest.approx(0.2, rel=1e-6)


@pytest.mark.parametrize("lag_s", [0.02, 0.1, 0.2])
def test_behind_a_lag_that_nobody_has_told_moves_lead_to_the_setpoint(lag_s: float) -> None:
    lags = {"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s}
    loop, errors_pct = Loop("nmpc", plant={"preset": "paper", "actuator": lags}), list[float]()
    for setpoint_m in (0.073, 0.087, 0.08, 0.076, 0.077, 0.09):
        loop.run(4.0, setpoint_m)
        errors_pct.append(100.0 * abs(loop.position_m - setpoint_m) / 0.127)
    assert max(errors_pct) < 1.0
    assert max(errors_pct[2:]) < 0.3
    assert 0.5 * lag_s < loop.state.control.memory.more_lag_s < 2.0 * lag_s


def test_a_valve_that_differs_from_its_configuration_is_out_of_specification() -> None:
    loop = Loop("nmpc", plant={"preset": "paper", "actuator": LAGS})
    loop.run(4.0, 0.073)
    loop.run(4.0, 0.087)
    guard = loop.state.guard
    assert (guard.mode, guard.cause) == (Mode.ACTIVE, Cause.VALVE_DIFFERS)
    assert guard.health(table_saved=True) is Health.OUT_OF_SPECIFICATION
    loop.run(0.05, 0.087, HostRequest.DISARM)
    assert not loop.state.differs


def test_a_setpoint_out_of_reach_says_nothing_against_the_valve() -> None:
    loop = Loop("nmpc")
    loop.run(0.6, 0.08)
    loop.run(3.0, 0.125)  # 20 mA open the valve to 99.9 mm
    loop.run(0.5, 0.08)
    assert not loop.state.differs
    assert loop.position_m == pytest.approx(0.08, abs=7e-4)
