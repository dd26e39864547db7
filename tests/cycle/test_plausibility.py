"""Readings that can be true, and those that cannot: quality, range, jumps, frozen values."""

from __future__ import annotations

import math

import pytest

from positioner.cycle.frozen import Noise
from positioner.cycle.plausibility import STOP_BAND_OF_SPAN, ReadingHistory, Refusal, check_reading
from positioner.guard.settings import GuardSettings
from positioner.valve.parameters import ValveParameters
from positioner.wire.messages import Counted, Quality, StemPosition

VALVE = ValveParameters(id="paper")
SETTINGS = GuardSettings(max_jump_m=0.01, frozen_s=1.0, frozen_command_ma=1.5)
PERIOD_S = 0.125  # a power of two: sums of it are exact
HERE_M = 0.08
BALANCE_MA = 52538.0 * HERE_M / (0.06452 * 0.75 * 6894.757)
STICK_BAND_MA = 1707.7 / (0.06452 * 0.75 * 6894.757)
EDGE_MA = BALANCE_MA + STICK_BAND_MA + 1.5


class Sensor:
    """Readings one after another, each a period after the one before."""

    def __init__(self, settings: GuardSettings = SETTINGS, valve: ValveParameters = VALVE) -> None:
        self.settings, self.valve = settings, valve
        self.history = ReadingHistory()

    def refuses(
        self, position_m: float, commanded_ma: float | None = None, elapsed_s: float = PERIOD_S
    ) -> Counted | None:
        message = StemPosition(position_m)
        self.history, doubt = check_reading(
            self.settings, self.valve, self.history, message, commanded_ma, elapsed_s, PERIOD_S
        )
        return doubt.counted if doubt else None


def test_a_reading_is_valid_and_never_frozen_while_no_command_acts_on_the_valve() -> None:
    frozen = Sensor()
    for _ in range(20):
        frozen.refuses(HERE_M, EDGE_MA + 1.0)
    assert frozen.refuses(HERE_M, EDGE_MA + 1.0) is Counted.FEEDBACK_FROZEN
    history = ReadingHistory()
    for _ in range(20):
        message = StemPosition(HERE_M, 0, Quality.FAIL_POSITION)
        history, doubt = check_reading(SETTINGS, VALVE, history, message, EDGE_MA + 1.0, PERIOD_S, PERIOD_S)
        assert doubt is None


def test_a_reading_of_quality_fault_is_implausible_and_a_suspect_one_is_plausible() -> None:
    history = ReadingHistory(0.05, 1, 0.09, 0.5)
    after, doubt = check_reading(
        SETTINGS, VALVE, history, StemPosition(HERE_M, 0, Quality.FAULT), None, PERIOD_S, PERIOD_S
    )
    assert doubt == Refusal(Counted.FEEDBACK_FAULT, "the sensor reports a fault")
    assert after == history
    after, doubt = check_reading(
        SETTINGS, VALVE, ReadingHistory(), StemPosition(HERE_M, 0, Quality.SUSPECT), None, PERIOD_S, PERIOD_S
    )
    assert (after, doubt) == (ReadingHistory(HERE_M, noise=Noise(HERE_M)), None)


@pytest.mark.parametrize(
    ("position_m", "doubted"),
    [(-0.0625, False), (-0.06251, True), (0.1875, False), (0.18751, True), (math.nan, True)],
)
def test_a_reading_lies_within_the_travel_and_its_margin(position_m: float, doubted: bool) -> None:
    valve = ValveParameters(id="binary", travel_min_m=0.0, travel_max_m=0.125)
    sensor = Sensor(GuardSettings(position_margin_m=0.0625), valve)
    assert sensor.refuses(position_m) is (Counted.FEEDBACK_RANGE if doubted else None)


def test_the_largest_step_is_plausible_in_both_directions() -> None:
    for end_m in (0.0625 + 0.0078125, 0.0625 - 0.0078125):
        sensor = Sensor(GuardSettings(max_jump_m=0.0078125))
        assert sensor.refuses(0.0625) is None
        assert sensor.refuses(end_m) is None
        assert sensor.refuses(math.nextafter(0.0625, end_m - 1.0 if end_m > 0.0625 else 1.0)) is Counted.FEEDBACK_JUMP


def test_jumps_agree_as_far_as_a_plausible_step() -> None:
    step_m = 0.0078125
    for beyond_m, believed in ((0.0, True), (1e-6, False)):
        sensor = Sensor(GuardSettings(max_jump_m=step_m))
        refused = [sensor.refuses(position_m) for position_m in (0.0625, 0.09375, 0.09375 + step_m + beyond_m, 0.09375)]
        assert (refused[3] is None) is believed


def test_three_jumps_to_one_place_are_believed() -> None:
    sensor = Sensor()
    refused = [sensor.refuses(position_m) for position_m in (0.05, 0.09, 0.095, 0.09)]
    assert refused == [None, Counted.FEEDBACK_JUMP, Counted.FEEDBACK_JUMP, None]
    assert (sensor.history.position_m, sensor.history.jumps, sensor.history.jumped_m) == (0.09, 0, None)


def test_jumps_to_and_fro_are_never_believed() -> None:
    sensor = Sensor()
    sensor.refuses(0.05)
    places = [0.09, 0.11, 0.13] * 10
    assert {sensor.refuses(position_m) for position_m in places} == {Counted.FEEDBACK_JUMP}
    assert sensor.history.position_m == 0.05


def test_a_jump_that_is_not_repeated_is_forgotten() -> None:
    sensor = Sensor()
    refused = [sensor.refuses(position_m) for position_m in (0.05, 0.09, 0.09, 0.05, 0.09, 0.09)]
    assert refused[3] is None
    assert refused[4:] == [Counted.FEEDBACK_JUMP] * 2


def test_a_jump_is_reported_in_mm() -> None:
    _, doubt = check_reading(SETTINGS, VALVE, ReadingHistory(0.05), StemPosition(0.0625), None, PERIOD_S, PERIOD_S)
    assert doubt == Refusal(Counted.FEEDBACK_JUMP, "a jump of 12.5 mm")
    _, doubt = check_reading(SETTINGS, VALVE, ReadingHistory(0.125), StemPosition(0.0), None, PERIOD_S, PERIOD_S)
    assert doubt == Refusal(Counted.FEEDBACK_JUMP, "a jump of 125.0 mm")


# frozen


def samples_until_frozen(sensor: Sensor, commanded_ma: float | None, position_m: float = HERE_M) -> int | None:
    for sample in range(100):
        if sensor.refuses(position_m, commanded_ma) is Counted.FEEDBACK_FROZEN:
            return sample
    return None


@pytest.mark.parametrize("above", [True, False])
def test_a_reading_that_stays_while_the_current_demands_motion_is_frozen_after_its_time(above: bool) -> None:
    commanded_ma = EDGE_MA + 0.01 if above else 2.0 * BALANCE_MA - EDGE_MA - 0.01
    # the first reading has none before it; then more than eight eighths of a second
    assert samples_until_frozen(Sensor(), commanded_ma) == 9
    assert samples_until_frozen(Sensor(GuardSettings(frozen_s=0.5)), commanded_ma) == 5


@pytest.mark.parametrize("above", [True, False])
def test_a_stem_that_sticks_in_its_band_is_never_frozen(above: bool) -> None:
    commanded_ma = EDGE_MA - 0.01 if above else 2.0 * BALANCE_MA - EDGE_MA + 0.01
    assert samples_until_frozen(Sensor(), commanded_ma) is None


def test_exactly_at_the_edge_a_stem_may_still_stick() -> None:
    """With numbers that need no rounding: 4 mA balance the spring, 1 mA is friction."""
    valve = ValveParameters(
        id="binary",
        diaphragm_area_m2=0.0625,
        pressure_gain_pa_per_ma=16384.0,
        spring_rate_n_per_m=65536.0,
        static_friction_n=1024.0,
        coulomb_friction_n=512.0,
    )
    assert samples_until_frozen(Sensor(valve=valve), 4.0 + 1.0 + 1.5, 0.0625) is None
    assert samples_until_frozen(Sensor(valve=valve), 4.0 + 1.0 + 1.5 + 1e-9, 0.0625) == 9


def test_the_time_of_lost_frames_counts() -> None:
    sensor = Sensor()
    sensor.refuses(HERE_M, 20.0)
    assert sensor.refuses(HERE_M, 20.0, 1.0) is None
    assert sensor.refuses(HERE_M, 20.0, 0.001) is Counted.FEEDBACK_FROZEN


def test_the_smallest_motion_proves_life_and_a_pause_between_two_pushes_does_not() -> None:
    sensor = Sensor()
    for _ in range(8):
        assert sensor.refuses(HERE_M, 20.0) is None
    assert sensor.refuses(HERE_M + 1e-8, 20.0) is None
    assert sensor.history.rigid_s == 0.0
    for _ in range(8):
        assert sensor.refuses(HERE_M + 1e-8, 20.0) is None
    for _ in range(50):
        assert sensor.refuses(HERE_M + 1e-8, BALANCE_MA) is None
    assert sensor.history.rigid_s == 1.0
    assert sensor.refuses(HERE_M + 1e-8, 20.0) is Counted.FEEDBACK_FROZEN


def test_frozen_stays_frozen_until_the_reading_moves_or_control_ends() -> None:
    for position_m, commanded_ma in ((HERE_M + 1e-8, 20.0), (HERE_M, None)):
        sensor = Sensor()
        assert samples_until_frozen(sensor, 20.0) == 9
        frozen_s = sensor.history.rigid_s
        assert sensor.refuses(HERE_M, BALANCE_MA) is Counted.FEEDBACK_FROZEN
        assert sensor.refuses(HERE_M, 20.0) is Counted.FEEDBACK_FROZEN
        assert sensor.history.rigid_s == frozen_s
        assert sensor.refuses(position_m, commanded_ma) is None
        assert sensor.history.rigid_s == 0.0


def test_without_a_command_nothing_is_frozen() -> None:
    assert samples_until_frozen(Sensor(), None) is None


def test_zero_seconds_mean_never() -> None:
    assert samples_until_frozen(Sensor(GuardSettings(frozen_s=0.0)), 20.0) is None


@pytest.mark.parametrize(
    ("position_m", "commanded_ma", "frozen"),
    [
        (0.0, 20.0, False),
        (STOP_BAND_OF_SPAN * 0.127, 20.0, False),
        (STOP_BAND_OF_SPAN * 0.127 + 1e-6, 20.0, True),
        (0.1397, 4.0, False),
        (0.1397 - STOP_BAND_OF_SPAN * 0.127, 4.0, False),
        (0.1397 - STOP_BAND_OF_SPAN * 0.127 - 1e-6, 4.0, True),
    ],
)
def test_a_stem_at_a_stop_may_rest_under_any_current(position_m: float, commanded_ma: float, frozen: bool) -> None:
    sensor = Sensor()
    assert (samples_until_frozen(sensor, commanded_ma, position_m) is not None) is frozen
    assert (sensor.history.rigid_s == 0.0) is not frozen


def test_the_stop_band_is_a_fiftieth_of_the_span_from_where_the_stops_are() -> None:
    assert STOP_BAND_OF_SPAN == 0.02
    valve = ValveParameters(id="v", travel_min_m=0.02, travel_max_m=0.12, span_m=0.1)
    for position_m, commanded_ma, frozen in ((0.0219, 20.0, 0), (0.0221, 20.0, 1), (0.1181, 4.0, 0), (0.1179, 4.0, 1)):
        assert (samples_until_frozen(Sensor(valve=valve), commanded_ma, position_m) is not None) is bool(frozen)


def test_the_refusal_shows_how_long_and_under_which_current() -> None:
    _, doubt = check_reading(
        SETTINGS, VALVE, ReadingHistory(HERE_M, rigid_s=1.0), StemPosition(HERE_M), 20.0, 0.25, 0.25
    )
    assert doubt is not None
    assert doubt.why == "frozen: not a bit of change for 1.25 s under 20.000 mA, which must move the stem"
