"""What the benchmark makes of its measurements."""

from __future__ import annotations

import pytest

from benchmarks.distribution import Distribution, smallest
from benchmarks.measure import Measured
from benchmarks.summary import check_bits


def test_a_quantile_is_the_smallest_duration_that_so_many_do_not_exceed() -> None:
    figures = Distribution.of([1000 * n for n in range(1, 1001)])
    assert (figures.count, figures.median, figures.p99, figures.p999, figures.largest) == (1000, 500, 990, 999, 1000)


def test_the_time_of_an_action_is_the_smallest_of_its_repeats() -> None:
    assert smallest([[5, 9, 3], [7, 2, 3], [6, 4, 8]]) == [5, 2, 3]


def test_repeats_with_different_results_are_refused() -> None:
    case = Measured("cycle 1 kHz", "interpreted", ("at rest",), [[1], [1]], ["a", "a"])
    check_bits([case])
    case.results[1] = "b"
    with pytest.raises(RuntimeError, match="cycle 1 kHz: two repeats gave different results"):
        check_bits([case])


def test_builds_with_different_results_are_refused() -> None:
    one = Measured("cycle 1 kHz", "interpreted", ("at rest",), [[1]], ["a"])
    other = Measured("cycle 1 kHz", "compiled", ("at rest",), [[1]], ["b"])
    with pytest.raises(RuntimeError, match="different results"):
        check_bits([one, other])
