"""The track of a slip: when it began, and where the stem is, against a valve that is integrated here."""

from __future__ import annotations

import math

import numpy as np
import pytest
from euler_valve import EulerValve

from positioner.laws.nmpc.belief import belief_of
from positioner.laws.nmpc.slip import numbers_of
from positioner.laws.nmpc.track import Doubt, Reading, Track
from positioner.values import replace
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters
from positioner.valve.rollout import Moving, Rollout, plant_of
from positioner.valve.sensor import sensor_lag
from positioner.valve.state import StemState

BOOST_MA = {1.0: 20.0, -1.0: 4.0}


def valve_of(lag_s: float) -> ValveParameters:
    return ValveParameters(
        id="paper", actuator=ActuatorParameters(fill_time_constant_s=lag_s, vent_time_constant_s=lag_s)
    )


def rollout_of(valve: ValveParameters, period_s: float) -> Rollout:
    return plant_of(valve, period_s, 0.0).rollout(numbers_of(belief_of(valve).numbers.mean))


def begun(rollout: Rollout, start_m: float, direction: float, push_ma2: float, static_ma2: float) -> Track:
    """Return the track of a stem that rests, the pressure in the middle of the stick band."""
    pressure = rollout.pressure.at_rest(rollout.numbers.spring_ma_per_m * start_m + rollout.numbers.offset_ma)
    return Track(
        Moving(pressure, StemState(start_m, 0.0, True, direction)), Doubt(1e-10, push_ma2), static_ma2, start_m
    )


def seen(
    period_s: float, lag_s: float, direction: float, friction: float, *, sensor_s: float = 0.0
) -> tuple[Track, EulerValve]:
    """Return the track, and the valve, in the sample that first shows the stem slide; friction: F_s over the told."""
    valve, sensor = valve_of(lag_s), sensor_lag(sensor_s, period_s)
    rollout = rollout_of(valve, period_s)
    track, boost_ma = begun(rollout, 0.09, direction, 0.01, 1.0), BOOST_MA[direction]
    true = EulerValve(valve, 0.09, track.moving.pressure.pressure_ma, period_s=period_s, sensor_s=sensor_s)
    true.static *= friction
    for _ in range(400):
        true.sample(boost_ma)
        track = track.after(rollout, Reading(boost_ma, true.seen, 1e-10, sensor))
        if not track.moving.stem.stuck:
            return track, true
    raise AssertionError("never seen to slide")


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("friction", [0.93, 1.0, 1.07])
@pytest.mark.parametrize(("period_s", "lag_s"), [(1e-3, 0.01), (2e-3, 0.05), (5e-3, 0.05), (1e-2, 0.1)])
def test_the_first_reading_of_a_slip_tells_place_and_speed(
    period_s: float, lag_s: float, direction: float, friction: float
) -> None:
    track, true = seen(period_s, lag_s, direction, friction)
    assert track.moving.stem.position_m == pytest.approx(true.x, abs=3e-5)
    assert abs(true.v) > 0.05
    assert track.moving.stem.velocity_m_per_s == pytest.approx(true.v, rel=0.12)


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("period_s", [1e-3, 5e-3])
def test_what_the_lag_of_the_sensor_hides_is_told_too(period_s: float, direction: float) -> None:
    track, true = seen(period_s, 0.05, direction, 1.05, sensor_s=0.004)
    assert track.moving.stem.position_m == pytest.approx(true.x, abs=4e-4)
    assert track.moving.stem.velocity_m_per_s == pytest.approx(true.v, rel=0.15)


def noisy(static_ma2: float, off_m: float) -> tuple[Track, float]:
    """Return the track after a reading that is so far off, σ 1 mm, is the first one, and where the stem is."""
    valve = valve_of(0.05)
    rollout, period_s = rollout_of(valve, 1e-3), 1e-3
    true = EulerValve(valve, 0.06, rollout.numbers.spring_ma_per_m * 0.06, period_s=period_s)
    track = begun(rollout, 0.06, 1.0, 0.01, static_ma2)
    for _ in range(400):
        read_m = true.sample(20.0)
        if true.x > 0.0665:
            return track.after(rollout, Reading(20.0, read_m + off_m, 1e-6)), true.x
        track = track.after(rollout, Reading(20.0, 0.06, 1e-6))
    raise AssertionError("never far enough")


def test_a_friction_that_is_known_well_is_believed_more_than_a_reading_that_is_noisy() -> None:
    known, x = noisy(1e-6, -0.001)
    assert known.moving.stem.position_m == pytest.approx(x, abs=2e-4)
    assert math.sqrt(known.doubt.xx) < 2e-4
    unknown, x = noisy(1.0, -0.001)
    assert unknown.moving.stem.position_m == pytest.approx(x - 0.001, abs=2e-4)
    assert 0.0007 < math.sqrt(unknown.doubt.xx) < 0.0011


@pytest.mark.parametrize(("noise_m", "frees"), [(1e-4, False), (0.0016, True)])
def test_where_no_reading_can_show_a_slip_jump_the_friction_that_is_believed_frees_the_stem(
    noise_m: float, frees: bool
) -> None:
    valve = valve_of(0.05)
    rollout = rollout_of(valve, 1e-3)
    track = begun(rollout, 0.06, 1.0, 0.01, 1.0)
    true = EulerValve(valve, 0.06, track.moving.pressure.pressure_ma)
    while true.x == 0.06:
        true.sample(20.0)
        track = track.after(rollout, Reading(20.0, 0.06, noise_m * noise_m))
    for _ in range(3):
        track = track.after(rollout, Reading(20.0, 0.06, noise_m * noise_m))
    assert track.moving.stem.stuck is not frees


def test_a_friction_that_a_reading_rules_out_is_a_push_that_is_not_known() -> None:
    valve = valve_of(0.05)
    rollout = rollout_of(valve, 1e-3)
    track = begun(rollout, 0.09, 1.0, 1e-4, 1e-6)
    true = EulerValve(valve, 0.09, track.moving.pressure.pressure_ma)
    true.static *= 0.88
    while track.moving.stem.stuck:
        track = track.after(rollout, Reading(20.0, true.sample(20.0), 1e-10))
    assert track.moving.stem.position_m == pytest.approx(true.x, abs=3e-5)
    assert math.sqrt(track.doubt.pp) == pytest.approx(0.12 * rollout.numbers.static_ma, rel=0.1)


@pytest.mark.parametrize(("sensor_s", "period_s"), [(0.002, 1e-3), (0.02, 1e-3), (0.004, 5e-3)])
def test_behind_the_lag_of_a_sensor_a_sliding_stem_is_where_it_is(sensor_s: float, period_s: float) -> None:
    track, true = seen(period_s, 0.05, 1.0, 1.0, sensor_s=sensor_s)
    rollout, sensor = rollout_of(valve_of(0.05), period_s), sensor_lag(sensor_s, period_s)
    track = replace(track, doubt=replace(track.doubt, pp=1.0))  # the readings count
    for _ in range(round(0.02 / period_s)):
        true.sample(20.0)
        track = track.after(rollout, Reading(20.0, true.seen, 1e-12, sensor))
    assert true.v > 0.1
    assert track.moving.stem.position_m == pytest.approx(true.x, abs=3e-5)  # half a sample of motion is 50 μm and more


def test_a_track_finds_the_force_that_pushes_a_sliding_stem() -> None:
    valve = valve_of(0.02)
    rollout = rollout_of(valve, 1e-3)
    track = begun(rollout, 0.05, 1.0, 0.1, 1.0)
    true = EulerValve(valve, 0.05, track.moving.pressure.pressure_ma)
    true.offset -= 0.3
    assert track.moving.shift_ma == 0.0
    for _ in range(60):
        track = track.after(rollout, Reading(19.0, true.sample(19.0), 2.5e-9))
    assert track.moving.shift_ma == pytest.approx(0.3, abs=0.05)
    assert track.moving.stem.position_m == pytest.approx(true.x, abs=2e-4)


def test_a_push_that_changes_on_the_way_is_followed_the_faster_the_more_it_is_expected_to() -> None:
    valve, off_ma = valve_of(0.02), []
    rollout = rollout_of(valve, 1e-3)
    for roams_ma2_per_m in (0.0, 1.0, 100.0):
        track = replace(begun(rollout, 0.05, 1.0, 0.1, 1.0), roams_ma2_per_m=roams_ma2_per_m)
        true = EulerValve(valve, 0.05, track.moving.pressure.pressure_ma)
        for sample in range(45):
            true.offset -= 0.4 if sample == 30 else 0.0
            track = track.after(rollout, Reading(19.0, true.sample(19.0), 2.5e-9))
        off_ma.append(abs(track.moving.shift_ma - 0.4))
    assert off_ma[0] > 2.0 * off_ma[1]
    assert off_ma[2] < 0.05


def test_noise_frees_no_stem_and_a_motion_does() -> None:
    valve, chance = valve_of(0.1), np.random.default_rng(4)
    rollout = rollout_of(valve, 1e-3)
    track = begun(rollout, 0.07, 1.0, 0.1, 1.0)
    held_ma = track.moving.pressure.pressure_ma
    for _ in range(2000):
        track = track.after(rollout, Reading(held_ma, 0.07 + 1e-4 * chance.normal(), 1e-8))
    assert track.moving.stem.stuck
    track = track.after(rollout, Reading(held_ma, 0.0708, 1e-8))
    assert not track.moving.stem.stuck
    assert 0.1 < track.moving.stem.velocity_m_per_s < 1.0
