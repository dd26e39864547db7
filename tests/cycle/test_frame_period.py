"""The period of the position frames: the median of a window, lost frames included."""

from __future__ import annotations

import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from positioner.cycle.frame_period import FramePeriod

MS = 1_000_000


def measured(intervals_ns: list[int], lost: int = 0) -> FramePeriod:
    frame_period, now_ns = FramePeriod().add(10**12, 0), 10**12
    for interval_ns in intervals_ns:
        now_ns += interval_ns
        frame_period = frame_period.add(now_ns, lost)
    return frame_period


@given(st.lists(st.integers(0, 50 * MS), min_size=50, max_size=50))
def test_the_measured_period_is_the_median_of_a_window(intervals_ns: list[int]) -> None:
    assert measured(intervals_ns).measured_s == pytest.approx(statistics.median(intervals_ns) / 1e9)
    assert measured(intervals_ns[:49]).measured_s is None


@pytest.mark.parametrize(("measured_ms", "wrong"), [(0.79, True), (0.81, False), (1.19, False), (1.21, True)])
def test_a_fifth_is_tolerated_both_ways(measured_ms: float, wrong: bool) -> None:
    assert measured([round(measured_ms * MS)] * 50).is_wrong(0.001) is wrong
    assert measured([round(3 * measured_ms * MS)] * 50, lost=2).is_wrong(0.001) is wrong


def test_frames_that_are_late_or_read_together_make_no_period_wrong() -> None:
    bursts = [4 * MS, 0, 0, 0] * 12 + [MS, MS]
    assert not measured([MS] * 30 + [9 * MS] * 5 + [0] * 15).is_wrong(0.001)
    assert measured(bursts).is_wrong(0.001)  # without the kernel's stamps, four at a time cannot be told from none


def test_each_window_is_measured_for_itself_and_the_last_measurement_stays_until_the_next() -> None:
    first = measured([2 * MS] * 50)
    assert first.measured_s == pytest.approx(0.002)
    now_ns = 10**12 + 100 * MS
    for count in range(1, 51):
        now_ns += 3 * MS
        first = first.add(now_ns, 0)
        assert first.measured_s == pytest.approx(0.003 if count == 50 else 0.002)


def test_lost_frames_share_the_interval_in_which_they_were_lost() -> None:
    assert measured([3 * MS] * 50, lost=2).measured_s == pytest.approx(0.001)


def test_nothing_is_wrong_before_a_period_was_measured() -> None:
    assert not measured([MS] * 49).is_wrong(1.0)
    assert not FramePeriod().is_wrong(0.001)


@pytest.mark.parametrize(("period_s", "wrong"), [(1.25, False), (1.26, True), (0.84, False), (0.83, True)])
def test_the_tolerance_is_a_fifth_of_the_configured_period(period_s: float, wrong: bool) -> None:
    assert measured([1000 * MS] * 50).is_wrong(period_s) is wrong
