"""Pushes that move nothing are told: of a frozen sensor without noise, and of a stuck stem."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from loop_helpers import Loop

from positioner.cycle.trust_events import PushFailed
from positioner.cycle.vain_pushes import (
    FAILED,
    LONG_ENOUGH_S,
    MOVED_OF_SPAN,
    NO_PUSHES,
    OFTEN_ENOUGH,
    NoMotion,
    VainPushes,
    are_in_vain,
    track_vain,
)
from positioner.values import replace
from positioner.valve.parameters import ValveParameters
from positioner.wire.messages import CanFrame, Cause, StemPosition

if TYPE_CHECKING:
    from typing import Any

VALVE = ValveParameters(id="paper")
HERE_M = 0.08
MIDDLE_MA = VALVE.balance_current_ma(HERE_M)
BAND_MA = 1707.7 / (0.06452 * 0.75 * 6894.757)
CLEAN = {"noise_of_reading": 0.0, "noise_of_span": 0.0}


def pushed(known: VainPushes, times: int, beyond_ma: float, repeat_s: float = 1.0) -> VainPushes:
    for _ in range(times):
        high_ma, low_ma = MIDDLE_MA + BAND_MA + beyond_ma, MIDDLE_MA - BAND_MA - beyond_ma
        for current_ma in (MIDDLE_MA, high_ma, high_ma, low_ma, MIDDLE_MA):
            known = track_vain(VALVE, known, HERE_M, HERE_M, repeat_s, current_ma, 0.001)
    return known


def test_a_push_goes_beyond_the_stick_band_and_back() -> None:
    assert pushed(NO_PUSHES, 7, 0.001).count == 7
    assert pushed(NO_PUSHES, 7, -0.001).count == 0
    assert pushed(NO_PUSHES, 7, 0.001, repeat_s=0.0) is NO_PUSHES


def test_ten_pushes_within_five_seconds_and_more_without_a_bit_of_change_are_in_vain() -> None:
    pushes = pushed(NO_PUSHES, OFTEN_ENOUGH, 0.1)
    assert are_in_vain(pushes, LONG_ENOUGH_S)
    assert not are_in_vain(pushes, LONG_ENOUGH_S - 0.01)
    assert not are_in_vain(pushed(NO_PUSHES, OFTEN_ENOUGH - 1, 0.1), 1e3)


def test_a_reading_that_changes_begins_anew() -> None:
    pushes = track_vain(VALVE, pushed(NO_PUSHES, OFTEN_ENOUGH, 0.1), HERE_M, HERE_M, 0.0, MIDDLE_MA, 0.001)
    assert pushes is NO_PUSHES


def test_twenty_pushes_in_a_row_that_the_law_has_found_to_fail_at_one_place_for_five_seconds_are_in_vain() -> None:
    pushes, step_s = NO_PUSHES, LONG_ENOUGH_S / FAILED
    for number in range(1, FAILED + 1):
        assert not are_in_vain(pushes, 0.0)
        pushes = pushes.after_failed(VALVE, number, HERE_M)
        pushes = track_vain(VALVE, pushes, HERE_M, HERE_M + 0.0025, 0.0, MIDDLE_MA, step_s)  # less than 2 % of span
        assert pushes.failed == number
        assert pushes.lasted_s == pytest.approx(number * step_s)
    assert are_in_vain(replace(pushes, lasted_s=LONG_ENOUGH_S), 0.0)
    assert not are_in_vain(replace(pushes, lasted_s=LONG_ENOUGH_S - 0.01), 0.0)  # a law that pushes in every cycle
    assert not are_in_vain(replace(pushes, lasted_s=LONG_ENOUGH_S, failed=FAILED - 1), 0.0)
    assert track_vain(VALVE, pushes, HERE_M, HERE_M + 0.0026, 0.0, MIDDLE_MA, step_s) == NO_PUSHES


def test_failed_pushes_from_several_places_are_not() -> None:
    pushes = NO_PUSHES
    for number in range(1, 3 * FAILED):
        pushes = pushes.after_failed(VALVE, number, HERE_M + 0.0026 * (number // 15))
        pushes = replace(pushes, lasted_s=LONG_ENOUGH_S)
        assert not are_in_vain(pushes, 0.0)
    pushes = NO_PUSHES
    for number in (*range(1, FAILED), *range(1, FAILED)):  # the law has seen the stem move in between
        pushes = replace(pushes.after_failed(VALVE, number, HERE_M), lasted_s=LONG_ENOUGH_S)
        assert not are_in_vain(pushes, 0.0)


@pytest.mark.parametrize("is_pushed", [False, True])
def test_failed_pushes_count_from_the_first_one_at_this_place(is_pushed: bool) -> None:
    first = VainPushes(is_pushed, 3).after_failed(VALVE, 7, 0.001)
    assert first == VainPushes(is_pushed, 3, failed=1, before=6, place_m=0.001)
    later = replace(first, lasted_s=2.0).after_failed(VALVE, 9, 0.002)
    assert later == VainPushes(is_pushed, 3, failed=3, before=6, place_m=0.001, lasted_s=2.0)
    assert later.after_failed(VALVE, 9, 0.004) == VainPushes(is_pushed, 3, failed=1, before=8, place_m=0.004)
    for fewer in (6, 2):  # one in between has moved the stem
        anew = VainPushes(is_pushed, 3, failed=1, before=fewer - 1, place_m=0.002)
        assert later.after_failed(VALVE, fewer, 0.002) == anew


def test_a_stem_that_has_moved_by_just_two_percent_of_the_span_is_still_at_its_place() -> None:
    limit_m = MOVED_OF_SPAN * VALVE.span_m
    pushes = VainPushes(failed=1)
    assert pushes.after_failed(VALVE, 2, limit_m).failed == 2
    assert track_vain(VALVE, pushes, 0.0, limit_m, 0.0, 0.0, 1.0) == VainPushes(failed=1, lasted_s=1.0)


@pytest.mark.parametrize(("current_ma", "is_pushed"), [(5.99, True), (6.0, False), (10.0, False), (10.01, True)])
def test_a_current_at_the_edge_of_the_stick_band_is_no_push(current_ma: float, is_pushed: bool) -> None:
    valve = ValveParameters(
        id="exact",
        diaphragm_area_m2=0.5,
        pressure_gain_pa_per_ma=16.0,  # 8 N/mA: the stem sticks from 6 to 10 mA
        bench_set_n=64.0,
        static_friction_n=16.0,
        coulomb_friction_n=16.0,
    )
    assert track_vain(valve, NO_PUSHES, 0.0, 0.0, 1.0, current_ma, 0.001).is_pushed is is_pushed


# through the whole cycle


def frozen(loop: Loop) -> None:
    """Let each reading from now on be the one that comes next."""
    kept: list[float] = []

    def freeze(frames: tuple[CanFrame, ...]) -> tuple[CanFrame, ...]:
        return tuple([_frozen(loop, frame, kept) for frame in frames])

    loop.to_positioner = freeze


def _frozen(loop: Loop, frame: CanFrame, kept: list[float]) -> CanFrame:
    message, counter = loop.codec.decode(frame)
    if not isinstance(message, StemPosition):
        return frame
    kept.append(message.position_m)
    return loop.codec.encode(replace(message, position_m=kept[0]), counter or 0)


def looped(sensor: dict[str, float], period_s: float, **valve: float) -> Loop:
    plant: dict[str, Any] = {"sensor": sensor, "valve": valve}
    return Loop(sample_period_s=period_s, setpoint_period_s=max(0.01, period_s), plant=plant)


@pytest.mark.parametrize(
    ("sensor", "period_s"), [({**CLEAN, "resolution_m": 5e-4}, 0.01), (CLEAN, 0.005), (CLEAN, 0.02)], ids=str
)
def test_a_clean_sensor_that_freezes_under_nmpc_is_found_out_after_twenty_pushes_at_last(
    sensor: dict[str, float], period_s: float
) -> None:
    loop = looped(sensor, period_s)
    loop.run(3.0, HERE_M)
    frozen(loop)
    for _ in range(60):
        loop.run(0.5, HERE_M + 0.0012)  # 0.94 % of span: up to 0.85 % a correction must pay
        if loop.state.guard.cause in {Cause.NO_MOTION, Cause.FEEDBACK_FROZEN}:
            break
    else:
        pytest.fail("nothing was told in 30 s")
    assert len(loop.events_of(PushFailed)) <= FAILED


def test_a_stem_that_is_stuck_under_a_noisy_sensor_is_told_from_an_error_on_that_is_no_deviation() -> None:
    loop = looped({}, 0.01)
    loop.run(2.0, HERE_M)
    stuck_m = loop.position_m
    valve = replace(loop.plant.valve, travel_min_m=stuck_m, travel_max_m=stuck_m + 1e-6, initial_position_m=stuck_m)
    loop.plant = replace(loop.plant, valve=valve)
    loop.run(60.0, HERE_M - 0.005)  # noise may look like a motion once: then twenty more pushes
    assert loop.state.guard.cause is Cause.NO_MOTION
    told = str(loop.events_of(NoMotion)[0])
    assert " pushes moved neither the stem nor its reading, " in told
    assert " mm: look for a frozen sensor" in told


@pytest.mark.parametrize("friction", [0.8, 1.2])
@pytest.mark.parametrize("sensor", [CLEAN, {**CLEAN, "resolution_m": 5e-4}, {}], ids=str)
def test_pushes_of_a_valve_with_another_friction_are_not_in_vain(sensor: dict[str, float], friction: float) -> None:
    loop = looped(sensor, 0.01, static_friction_n=friction * 1707.7, coulomb_friction_n=friction * 1423.0)
    for place_m in (0.075, 0.0765, 0.084, 0.0832, 0.071):
        loop.run(4.0, place_m)
    assert not loop.events_of(NoMotion)


def test_a_stem_that_rests_at_the_end_of_its_reach_is_not_told_so() -> None:
    loop = Loop(sample_period_s=0.01, setpoint_period_s=0.01, plant={"sensor": CLEAN})
    loop.run(3.0, 0.095)
    for beyond_m in (0.1005, 0.11, 0.127):  # 20 mA open it to 99.9 mm
        loop.run(8.0, beyond_m)
        assert loop.state.guard.cause in {Cause.NONE, Cause.SETPOINT_UNREACHABLE}
    assert not loop.events_of(NoMotion)
