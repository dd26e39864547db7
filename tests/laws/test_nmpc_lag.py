"""The lag that one move shows, against a stem that follows its balance, integrated step by step."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import pytest
from loop_helpers import Loop

from positioner.laws.nmpc.belief import DEAD_TIME, LAG, Landing, belief_of
from positioner.laws.nmpc.kept import lesson_of, taught
from positioner.laws.nmpc.lag import Way, more_lag_s
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters
from positioner.valve.stiction import StictionTable
from positioner.wire.messages import Cause, Health, HostRequest, Mode

PAPER = ValveParameters(id="paper")
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


@pytest.mark.parametrize(("lag_s", "most_pct"), [(0.02, 0.6), (0.1, 0.3), (0.2, 0.8)])  # 2 % of the reading is noise
def test_behind_a_lag_that_nobody_has_told_moves_lead_to_the_setpoint(lag_s: float, most_pct: float) -> None:
    lags = {"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s}
    loop, errors_pct = Loop("nmpc", plant={"preset": "paper", "actuator": lags}), list[float]()
    for setpoint_m in (0.073, 0.087, 0.08, 0.076, 0.077, 0.09):
        loop.run(4.0, setpoint_m)
        errors_pct.append(100.0 * abs(loop.position_m - setpoint_m) / 0.127)
    assert max(errors_pct) < 1.0
    assert max(errors_pct[2:]) < most_pct
    assert 0.5 * lag_s < loop.state.control.memory.belief.lag_s < 2.0 * lag_s


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


@pytest.mark.parametrize(("believed_ms", "seen_ms", "is_other", "more_ms"), [
    (100.0, 128.0, False, 0.0),
    (100.0, 128.0, True, 11.2),
    (100.0, 145.0, False, 45.0),
    (100.0, 65.0, False, 0.0),
    (100.0, 40.0, False, -60.0),
    (0.0, 8.0, False, 0.0),
    (0.0, 30.0, False, 30.0),
])  # fmt: skip
def test_a_lag_that_is_seen_by_far_longer_or_shorter_is_another_one(
    believed_ms: float, seen_ms: float, is_other: bool, more_ms: float
) -> None:
    found_s = more_lag_s(1e-3 * believed_ms, 1e-3 * seen_ms, 0.01, is_other=is_other)
    assert 1e3 * found_s == pytest.approx(more_ms)


@pytest.mark.parametrize("told_ms", [0.0, 1.0, 20.0, 300.0])
def test_a_lag_is_believed_with_a_doubt_of_a_part_and_a_millisecond(told_ms: float) -> None:
    lags = {"fill_time_constant_s": 1e-3 * told_ms, "vent_time_constant_s": 1e-3 * told_ms}
    belief = belief_of(replace(PAPER, actuator=ActuatorParameters(**lags)))
    sigma_ms = (told_ms + 1.0) * math.sqrt(belief.numbers.variances[LAG])
    assert 1e3 * belief.lag_s == pytest.approx(told_ms)
    assert sigma_ms == pytest.approx(math.hypot(0.12 * told_ms, 1.0))
    longer = belief.within(belief.numbers.with_mean((*belief.numbers.mean[:LAG], 5.0, 0.0, 0.0)))
    most = max(0.7, 2.0 * math.sqrt(belief.numbers.variances[LAG]))  # twice at a time, or two σ
    assert math.exp(longer.mean[LAG]) == pytest.approx(1e-3 * (told_ms + 1.0) * math.exp(most))
    assert math.exp(most) == pytest.approx({0.0: math.exp(2.0), 1.0: 2.74}.get(told_ms, math.exp(0.7)), rel=0.01)
    shorter = belief.within(belief.numbers.with_mean((*belief.numbers.mean[:LAG], -50.0, 0.0, -0.1)))
    assert math.exp(shorter.mean[LAG]) == pytest.approx(1e-3 * max((told_ms + 1.0) * math.exp(-0.7), 1.0))
    assert shorter.mean[DEAD_TIME] == 0.0


@pytest.mark.parametrize("told_s", [0.0, 0.1])
def test_a_lag_that_was_seen_is_another_valve_and_survives_a_restart(told_s: float) -> None:
    lags = {"fill_time_constant_s": told_s, "vent_time_constant_s": told_s}
    valve = replace(PAPER, actuator=ActuatorParameters(**lags))
    told, seen = belief_of(valve), belief_of(valve).with_lag(0.25)
    assert seen.differs
    assert not told.with_lag(1.2 * told_s).differs
    lesson = lesson_of(seen, Landing(0.08, 1.0, seen.landing_ma(0.08, 1.0)), valve)
    again = taught(told, StictionTable().learned(lesson), valve, 1e-5)
    assert again.lag_s == pytest.approx(0.25, rel=0.05)
    assert again.differs


def test_a_table_without_a_lag_says_nothing_of_it() -> None:
    told = belief_of(PAPER)
    lesson = lesson_of(told, Landing(0.08, 1.0, told.landing_ma(0.08, 1.0)), PAPER)
    again = taught(told, StictionTable().learned(lesson), PAPER, 1e-5)
    assert again.lag_s == 0.0
    assert again.numbers.variances[LAG] == pytest.approx(told.numbers.variances[LAG])


@pytest.mark.parametrize("lag_s", [0.0005, 0.001, 0.002])
def test_a_lag_of_a_millisecond_is_learned_from_the_ways_of_braked_moves(lag_s: float) -> None:
    lags = {"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s}
    loop, errors_pct = Loop("nmpc", plant={"preset": "paper", "actuator": lags}), list[float]()
    for setpoint_m in (0.073, 0.087, 0.08, 0.076, 0.09, 0.07, 0.085):
        loop.run(2.0, setpoint_m)
        errors_pct.append(100.0 * abs(loop.position_m - setpoint_m) / 0.127)
    assert max(errors_pct[3:]) < 0.8  # 2 % of the reading is noise
    assert 0.4 * lag_s < loop.state.control.memory.belief.lag_s < 2.0 * lag_s


def test_a_push_that_goes_on_with_one_in_vain_says_nothing_of_the_lag() -> None:
    loop = Loop("nmpc", plant={"preset": "paper"})
    loop.run(0.1, 0.08)
    memory = loop.state.control.memory
    friction_ma, level_ma = memory.belief.sliding_ma, memory.move.level_ma
    pushed = memory.held(memory.belief)
    for steps, is_blind in ((1.8, True), (2.2, False)):
        move = replace(memory.move, from_ma=level_ma - steps * friction_ma)
        assert replace(pushed, move=move).is_blind is is_blind
        assert not replace(memory, move=move, unpushed=None).is_blind
