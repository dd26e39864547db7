"""When a frame arrived, by a stamp that may be wrong, and for how long the loop did not receive."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from positioner.bus.arrivals import Arrivals
from positioner.machine.time import Instant

MS = 1_000_000
BOOT_NS, WALL_NS = 10**12, 1_700_000_000 * 10**9


def at(since_ms: float, stepped_ms: float = 0.0) -> Instant:
    return Instant(BOOT_NS + round(since_ms * MS), WALL_NS + round((since_ms + stepped_ms) * MS))


def empty_at(instant: Instant) -> Arrivals:
    arrivals = Arrivals()
    arrivals.begin(instant, 0.01)
    arrivals.seen_empty(instant)
    return arrivals


@given(waited_ms=st.floats(0.0, 100.0), since_empty_ms=st.floats(0.0, 60_000.0))
def test_an_honest_stamp_gives_the_instant_of_arrival(waited_ms: float, since_empty_ms: float) -> None:
    waited_ms = min(waited_ms, since_empty_ms)
    now = at(since_empty_ms)
    arrived_ns = empty_at(at(0.0)).arrived_ns((now.wall_ns - waited_ms * MS) / 1e9, now)
    assert arrived_ns == pytest.approx(now.monotonic_ns - waited_ms * MS, abs=1500)  # a double holds 0.24 µs of 1.7e9 s
    assert arrived_ns % 1000 == 0


@given(
    stamp_s=st.floats(allow_nan=True, allow_infinity=True),
    since_empty_ms=st.floats(0.0, 60_000.0),
    stepped_ms=st.floats(-1e9, 1e9),
)
def test_whatever_the_stamp_a_frame_arrived_after_the_queue_was_empty_and_before_now(
    stamp_s: float, since_empty_ms: float, stepped_ms: float
) -> None:
    now = at(since_empty_ms, stepped_ms)
    arrived_ns = empty_at(at(0.0)).arrived_ns(stamp_s, now)
    assert BOOT_NS - 1000 < arrived_ns <= now.monotonic_ns


@pytest.mark.parametrize("stamp_s", [0.0, math.nan, math.inf, -math.inf, 1e300, 12.5, WALL_NS / 1e9 + 3600.0])
def test_a_stamp_that_is_absurd_means_since_the_queue_was_empty(stamp_s: float) -> None:
    assert empty_at(at(0.0)).arrived_ns(stamp_s, at(250.0)) == BOOT_NS


@pytest.mark.parametrize(
    ("stepped_ms", "believed"), [(1.1, True), (-1.1, True), (1.3, False), (-1.3, False), (-3.6e6, False)]
)
def test_a_stepped_clock_voids_the_stamps_since_the_queue_was_empty(stepped_ms: float, believed: bool) -> None:
    now = at(200.0, stepped_ms)  # 1 ms, and a thousandth of 200 ms, may be slew
    arrived_ns = empty_at(at(0.0)).arrived_ns((now.wall_ns - 50 * MS) / 1e9, now)
    expected_ns = now.monotonic_ns - 50 * MS if believed else BOOT_NS
    assert arrived_ns == pytest.approx(expected_ns, abs=1500)


def test_a_bus_that_was_opened_again_has_an_empty_queue() -> None:
    arrivals = empty_at(at(0.0))
    arrivals.reopened(at(5000.0))
    assert arrivals.arrived_ns(0.0, at(5001.0)) == BOOT_NS + 5000 * MS
    assert Arrivals().arrived_ns(0.0, at(1.0)) == BOOT_NS + MS


@pytest.mark.parametrize(
    ("away_ms", "inside_ms", "expected_ms"),
    [
        (0.0, 4.0, 0.0),  # a wait that was asked for
        (0.0, 10.0, 0.0),
        (3.0, 10.0, 3.0),
        (3.0, 12.0, 5.0),
        (0.0, 20.0, 10.0),
        (0.0, 20.5, 20.5),  # a process stopped while it waited may have been stopped from the beginning
        (7.0, 5000.0, 5007.0),
    ],
)
def test_the_gap_is_the_time_beyond_the_timeout(away_ms: float, inside_ms: float, expected_ms: float) -> None:
    arrivals = Arrivals()
    arrivals.begin(at(0.0), 0.01)
    arrivals.end(at(2.0))
    assert arrivals.gap_ns == 0
    arrivals.begin(at(2.0 + away_ms), 0.01)
    arrivals.end(at(2.0 + away_ms + inside_ms))
    assert arrivals.gap_ns == pytest.approx(expected_ms * MS)
