"""An error that stays is reported, whatever the reason; a stem on its way, however slow, is not."""

from __future__ import annotations

import math
import random
from typing import TYPE_CHECKING

import pytest

from positioner.cycle.deviation import (
    NO_DEVIATION,
    PROGRESS_OF_LIMIT,
    RETURN_OF_LIMIT,
    UNREACHABLE_OF_LIMIT,
    Deviation,
    description,
    is_reachable,
    reach_m,
    track_deviation,
)
from positioner.cycle.full_push import FullPush
from positioner.guard.settings import GuardSettings
from positioner.valve.parameters import ValveParameters
from positioner.wire.messages import Cause

if TYPE_CHECKING:
    from collections.abc import Iterable

SETTINGS = GuardSettings()
VALVE = ValveParameters(id="paper")
PERIOD_S = 0.001
LIMIT_M = 0.05 * 0.127
LEAST_PROGRESS_M = PROGRESS_OF_LIMIT * SETTINGS.deviation_of_span * VALVE.span_m
HERE_M, THERE_M = 0.075, 0.085


def test_a_stem_within_four_fifths_of_the_least_limit_is_pushed_nowhere() -> None:
    most_m = RETURN_OF_LIMIT * (UNREACHABLE_OF_LIMIT * (SETTINGS.deviation_of_span * VALVE.span_m))
    for setpoint_m, direction in ((0.0, 0), (most_m, 0), (-most_m, 0), (1.001 * most_m, 1), (-1.001 * most_m, -1)):
        found = track_deviation(SETTINGS, VALVE, NO_DEVIATION, 0.0, setpoint_m, PERIOD_S, 12.0)
        assert found.push.direction == direction


def test_pushes_that_a_law_has_found_to_fail_are_known() -> None:
    push = FullPush(20.0, 1, HERE_M, 0.1, 0, was_full=True)
    known = Deviation(HERE_M, 1, HERE_M, HERE_M, 0.5, Cause.NONE, push)
    after = known.after_failed(2, THERE_M)
    assert after == Deviation(HERE_M, 1, HERE_M, HERE_M, 0.5, Cause.NONE, FullPush(20.0, 1, THERE_M, 0.1, 2))


class Watch:
    """Readings one after another, each a period after the one before."""

    def __init__(self, settings: GuardSettings = SETTINGS, period_s: float = PERIOD_S) -> None:
        self.settings, self.period_s, self.known = settings, period_s, NO_DEVIATION

    def sees(self, position_m: float, setpoint_m: float, sent_ma: float | None = None) -> Cause:
        self.known = track_deviation(self.settings, VALVE, self.known, position_m, setpoint_m, self.period_s, sent_ma)
        return self.known.cause

    def reported_after_s(self, readings: Iterable[float], setpoint_m: float) -> float | None:
        """Return when the first cause was reported in s, None if none was."""
        for count, position_m in enumerate(readings, start=1):
            if self.sees(position_m, setpoint_m) is not Cause.NONE:
                return count * self.period_s
        return None


def resting(seconds: float, place_m: float = HERE_M, noise: float = 0.0, held: int = 1) -> Iterable[float]:
    chance, draw_m = random.Random(1), place_m  # noqa: S311 - noise that can be repeated, no secret
    for count in range(round(seconds / PERIOD_S)):
        draw_m = place_m * (1.0 + chance.gauss(0.0, noise)) if count % held == 0 else draw_m
        yield draw_m


@pytest.mark.parametrize(("noise", "held"), [(0.0, 1), (0.02, 1), (0.02, 10)])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_stem_that_stays_away_is_reported_within_two_seconds(sign: int, noise: float, held: int) -> None:
    watch = Watch()
    assert watch.reported_after_s(resting(2.0, noise=noise, held=held), HERE_M) is None
    reported_s = watch.reported_after_s(resting(4.0, noise=noise, held=held), HERE_M + sign * 0.01)
    assert reported_s is not None
    assert 1.5 < reported_s < 1.95
    assert watch.known.cause is Cause.DEVIATION


@pytest.mark.parametrize(("part", "reported"), [(0.99, False), (1.01, True)])
def test_the_limit_is_a_part_of_the_span(part: float, reported: bool) -> None:
    watch = Watch()
    assert (watch.reported_after_s(resting(4.0), HERE_M + part * LIMIT_M) is not None) is reported
    wide = Watch(GuardSettings(deviation_of_span=0.1))
    assert wide.reported_after_s(resting(4.0), HERE_M + 1.99 * LIMIT_M) is None
    assert wide.reported_after_s(resting(4.0), HERE_M - 2.01 * LIMIT_M) is not None


def test_the_time_is_a_setting_and_a_limit_of_zero_means_never() -> None:
    slow = Watch(GuardSettings(deviation_s=5.0))
    assert slow.reported_after_s(resting(9.0), THERE_M) == pytest.approx(5.0, abs=0.01)
    assert Watch(GuardSettings(deviation_of_span=0.0)).reported_after_s(resting(9.0), THERE_M) is None


def test_noise_is_no_error() -> None:
    """2 % of the reading, 1.3 % of span: single readings are 5 % off now and then."""
    assert Watch().reported_after_s(resting(60.0, noise=0.02, held=10), HERE_M + 0.9 * 0.8 * LIMIT_M) is None


@pytest.mark.parametrize("stroke_s", [2.0, 20.0, 40.0])
def test_a_long_stroke_is_no_deviation_as_long_as_the_stem_comes_nearer(stroke_s: float) -> None:
    low_m, high_m = 0.055, 0.095
    samples = round(stroke_s / PERIOD_S)
    readings = [low_m + (high_m - low_m) * count / samples for count in range(samples)]
    assert Watch().reported_after_s(readings, high_m) is None
    assert Watch().reported_after_s(readings[::-1], low_m) is None


def test_a_stem_that_crawls_by_less_than_a_hundredth_of_the_span_in_its_time_is_reported() -> None:
    samples = 80_000
    readings = [0.055 + 0.04 * count / samples for count in range(samples)]
    assert Watch().reported_after_s(readings, 0.095) is not None


def test_setpoints_that_come_and_go_do_not_start_the_time_again() -> None:
    """A dead actuator under a host that sends another setpoint every half second."""
    watch, reported = Watch(), None
    for count in range(3000):
        setpoint_m = HERE_M + (0.01 if count // 500 % 2 else -0.01)
        if watch.sees(HERE_M, setpoint_m) is not Cause.NONE and reported is None:
            reported = count
    assert reported is not None
    assert 1490 < reported < 1600


def test_a_stem_that_follows_such_setpoints_is_no_deviation() -> None:
    watch, here_m = Watch(), HERE_M
    for count in range(20_000):
        setpoint_m = HERE_M + (0.02 if count // 1000 % 2 else -0.02)
        here_m += (setpoint_m - here_m) * PERIOD_S / 1.0  # a lag of a second
        assert watch.sees(here_m, setpoint_m) is Cause.NONE


def test_a_deviation_ends_well_within_the_limit_and_starts_again() -> None:
    watch = Watch()
    assert watch.reported_after_s(resting(2.0), THERE_M) is not None
    for error, cause in ((0.85, Cause.DEVIATION), (1.2, Cause.DEVIATION), (0.75, Cause.NONE), (0.95, Cause.NONE)):
        for position_m in resting(1.0, THERE_M - error * LIMIT_M):
            watch.sees(position_m, THERE_M)
        assert watch.known.cause is cause
    assert watch.reported_after_s(resting(2.0), THERE_M) == pytest.approx(1.5, abs=0.05)


# reach


def test_the_reach_is_where_spring_friction_and_current_balance() -> None:
    gain = 0.06452 * 0.75 * 6894.757
    low_m, high_m = reach_m(SETTINGS, VALVE)
    assert high_m == pytest.approx((20.0 * gain - 1423.0) / 52538.0)
    assert low_m == pytest.approx((4.0 * gain + 1423.0) / 52538.0)
    narrow = reach_m(GuardSettings(current_low_ma=5.0, current_high_ma=19.0), VALVE)
    assert narrow == pytest.approx((low_m + gain / 52538.0, high_m - gain / 52538.0))
    loaded = reach_m(SETTINGS, ValveParameters(id="v", bench_set_n=525.38))
    assert loaded == pytest.approx((low_m - 0.01, high_m - 0.01))


def test_a_setpoint_is_out_of_reach_from_one_side() -> None:
    low_m, high_m = reach_m(SETTINGS, VALVE)
    assert is_reachable(SETTINGS, VALVE, high_m, 0.08)
    assert not is_reachable(SETTINGS, VALVE, high_m + 1e-6, 0.08)
    assert is_reachable(SETTINGS, VALVE, high_m + 1e-6, 0.12)
    assert is_reachable(SETTINGS, VALVE, low_m, 0.08)
    assert not is_reachable(SETTINGS, VALVE, low_m - 1e-6, 0.08)
    assert is_reachable(SETTINGS, VALVE, low_m - 1e-6, 0.01)


def test_a_setpoint_out_of_reach_is_reported_as_such_from_a_small_error_on() -> None:
    high_m = reach_m(SETTINGS, VALVE)[1]
    for beyond_m, reported in ((0.0011, False), (0.0014, True), (0.03, True)):
        watch = Watch()
        assert (watch.reported_after_s(resting(3.0, high_m), high_m + beyond_m) is not None) is reported
        assert watch.known.cause is (Cause.SETPOINT_UNREACHABLE if reported else Cause.NONE)


def test_the_next_setpoint_within_reach_starts_again() -> None:
    watch = Watch()
    assert watch.reported_after_s(resting(3.0), 0.127) is not None
    assert watch.reported_after_s(resting(3.0), THERE_M) == pytest.approx(1.5, abs=0.01)
    assert watch.known.cause is Cause.DEVIATION
    assert watch.sees(HERE_M, 0.127) is Cause.SETPOINT_UNREACHABLE


def test_a_stem_that_all_the_current_does_not_move_is_at_the_end_of_its_reach_from_a_small_error_on() -> None:
    for beyond_m, sent_ma, cause in (
        (0.0011, 20.0, Cause.NONE),
        (0.0014, 20.0, Cause.SETPOINT_UNREACHABLE),
        (0.0014, 19.5, Cause.NONE),
        (0.0100, 19.5, Cause.DEVIATION),
        (0.0100, 20.0, Cause.SETPOINT_UNREACHABLE),
        (-0.0100, 20.0, Cause.DEVIATION),
    ):
        watch = Watch()
        for position_m in resting(2.0):
            watch.sees(position_m, HERE_M + beyond_m, sent_ma)
        assert watch.known.cause is cause, (beyond_m, sent_ma)


def test_a_stem_that_moves_under_all_the_current_is_on_its_way() -> None:
    watch = Watch()
    for count in range(30_000):  # full travel would last 95 s
        assert watch.sees(0.055 + 0.04 * count / 30_000, 0.095, 20.0) is Cause.NONE


def test_a_stem_that_goes_on_after_all_has_reached_its_setpoint() -> None:
    watch = Watch()
    causes = [watch.sees(position_m, THERE_M, 20.0) for position_m in resting(2.0)]
    causes += [watch.sees(position_m, THERE_M, 16.0) for position_m in resting(1.0, THERE_M - 0.002)]
    assert (causes[1999], causes[-1]) == (Cause.SETPOINT_UNREACHABLE, Cause.NONE)


# one reading at a time: without a mean, the reading is the mean


def test_with_a_limit_of_zero_nothing_is_kept() -> None:
    off = GuardSettings(deviation_of_span=0.0)
    assert track_deviation(off, VALVE, Deviation(HERE_M, 1), HERE_M, THERE_M, 1.0, None) is NO_DEVIATION


def test_an_error_of_the_limit_is_none() -> None:
    limit_m = SETTINGS.deviation_of_span * VALVE.span_m
    assert track_deviation(SETTINGS, VALVE, NO_DEVIATION, 0.0, limit_m, 0.25, None) == Deviation(position_m=0.0)
    beyond_m = math.nextafter(limit_m, 1.0)
    found = track_deviation(SETTINGS, VALVE, NO_DEVIATION, 0.0, beyond_m, 0.25, None)
    assert found == Deviation(position_m=0.0, direction=1, mark_m=0.0, from_m=0.0, waited_s=0.25)


def test_a_setpoint_on_the_other_side_keeps_the_time_and_the_place_from_which_the_stem_came() -> None:
    known = Deviation(direction=1, mark_m=0.07, from_m=0.06, waited_s=0.5)
    found = track_deviation(SETTINGS, VALVE, known, HERE_M, HERE_M - 0.01, 0.25, None)
    assert found == Deviation(position_m=HERE_M, direction=-1, mark_m=HERE_M, from_m=0.06, waited_s=0.75)


def test_the_least_progress_starts_the_time_again_and_a_little_less_does_not() -> None:
    known = Deviation(direction=1, mark_m=0.0, from_m=0.0, waited_s=0.5)
    assert track_deviation(SETTINGS, VALVE, known, LEAST_PROGRESS_M, 0.08, 0.25, None).waited_s == 0.0
    less_m = math.nextafter(LEAST_PROGRESS_M, 0.0)
    assert track_deviation(SETTINGS, VALVE, known, less_m, 0.08, 0.25, None).waited_s == 0.75


def test_the_cause_is_reported_only_after_the_time() -> None:
    known = Deviation(direction=1, mark_m=HERE_M, from_m=HERE_M, waited_s=SETTINGS.deviation_s - 0.25)
    assert track_deviation(SETTINGS, VALVE, known, HERE_M, THERE_M, 0.25, None).cause is Cause.NONE
    assert track_deviation(SETTINGS, VALVE, known, HERE_M, THERE_M, 0.26, None).cause is Cause.DEVIATION


def test_a_stem_at_a_setpoint_beyond_the_reach_of_opening_can_stay_there() -> None:
    assert is_reachable(SETTINGS, VALVE, 0.127, 0.127)
    assert not is_reachable(SETTINGS, VALVE, 0.127, 0.126)


# words


@pytest.mark.parametrize(
    ("known", "setpoint_m", "reported"),
    [
        (
            Deviation(0.075, 1, 0.075, 0.075, 1.5, Cause.DEVIATION),
            0.084,
            (
                "the stem is 9.0 mm below its setpoint of 84.0 mm and came no nearer for 1.5 s: "
                "look at air, actuator and sensor"
            ),
        ),
        (
            Deviation(0.095, -1, 0.075, 0.075, 1.5, Cause.DEVIATION),
            0.065,
            "the stem is 30.0 mm above its setpoint of 65.0 mm and went 20.0 mm the other way: is the action reversed?",
        ),
        (
            Deviation(0.0999, 1, 0.0999, 0.0999, 1.5, Cause.SETPOINT_UNREACHABLE),
            0.127,
            "the stem is 27.1 mm below its setpoint of 127.0 mm, which is out of reach: 20 mA open it to 99.9 mm",
        ),
        (
            Deviation(0.0525, -1, 0.0525, 0.0525, 1.5, Cause.SETPOINT_UNREACHABLE),
            0.02,
            "the stem is 32.5 mm above its setpoint of 20.0 mm, which is out of reach: 4 mA close it to 52.5 mm",
        ),
        (
            Deviation(0.0799, 1, 0.0799, 0.0799, 1.5, Cause.SETPOINT_UNREACHABLE),
            0.092,
            (
                "the stem is 12.1 mm below its setpoint of 92.0 mm, which is out of reach: "
                "20 mA do not move it from 79.9 mm, by a stiffer spring or more friction than configured"
            ),
        ),
        (
            Deviation(0.0657, -1, 0.0657, 0.0657, 1.5, Cause.SETPOINT_UNREACHABLE),
            0.06,
            (
                "the stem is 5.7 mm above its setpoint of 60.0 mm, which is out of reach: "
                "4 mA do not move it from 65.7 mm, by a softer spring or more friction than configured"
            ),
        ),
        (
            Deviation(cause=Cause.SETPOINT_UNREACHABLE),
            0.08,
            (
                "the stem is 0.0 mm above its setpoint of 80.0 mm, which is out of reach: "
                "4 mA do not move it from 80.0 mm, by a softer spring or more friction than configured"
            ),
        ),
        (
            Deviation(1.25, -1, 0.25, 0.25, 1.5, Cause.DEVIATION),
            -1.0,
            (
                "the stem is 2250.0 mm above its setpoint of -1000.0 mm and went 1000.0 mm the other way: "
                "is the action reversed?"
            ),
        ),
        (
            Deviation(LEAST_PROGRESS_M, -1, 0.0, 0.0, 1.5, Cause.DEVIATION),
            -0.02,
            (
                "the stem is 21.3 mm above its setpoint of -20.0 mm and came no nearer for 1.5 s: "
                "look at air, actuator and sensor"
            ),
        ),
    ],
)
def test_the_description_names_what_the_readings_show(known: Deviation, setpoint_m: float, reported: str) -> None:
    assert description(SETTINGS, VALVE, known, setpoint_m) == reported


def test_the_description_of_what_is_out_of_reach_names_the_limit_of_the_configuration() -> None:
    narrow = GuardSettings(current_low_ma=17.0)
    known = Deviation(0.1375, -1, 0.1375, 0.1375, 1.5, Cause.SETPOINT_UNREACHABLE)
    closed_mm = f"{1e3 * reach_m(narrow, VALVE)[0]:.1f}"
    assert description(narrow, VALVE, known, 0.1).endswith(f"out of reach: 17 mA close it to {closed_mm} mm")


def test_a_stem_that_goes_the_other_way_is_described_so() -> None:
    watch = Watch()
    readings = [HERE_M - 0.02 * min(count, 500) / 500 for count in range(4000)]
    assert watch.reported_after_s(readings, THERE_M) is not None
    assert "went 20.0 mm the other way" in description(SETTINGS, VALVE, watch.known, THERE_M)
