"""Durations as people write them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from positioner.cycle.timing_events import LawLate, Stalled
from positioner.inputs.durations import duration


@pytest.mark.parametrize(
    ("seconds", "digits", "text"),
    [
        (0.0, 6, "0 s"),
        (0.00005, 6, "0.05 ms"),
        (0.02, 6, "20 ms"),
        (0.12, 2, "120 ms"),
        (0.9994, 3, "999 ms"),
        (0.9999, 3, "1 s"),
        (1.0, 6, "1 s"),
        (1.5, 3, "1.5 s"),
        (3600.0, 3, "3600 s"),
        (1234567.0, 3, "1230000 s"),
        (-0.005, 3, "-5 ms"),
    ],
)
def test_a_duration_has_its_unit_and_no_exponent(seconds: float, digits: int, text: str) -> None:
    assert duration(seconds, digits) == text


@given(st.floats(1e-6, 1e12), st.integers(2, 6))
def test_whatever_the_duration_it_reads_back_and_has_no_exponent(seconds: float, digits: int) -> None:
    number, unit = duration(seconds, digits).split()
    value_s = float(number) * {"ms": 1e-3, "s": 1.0}[unit]
    assert "e" not in number
    assert value_s == pytest.approx(seconds, rel=0.51 * 10.0 ** (1 - digits))


def test_a_stall_of_a_second_is_told_in_seconds() -> None:
    assert "stood still for 1 s:" in str(Stalled(stall_ns=1_000_000_000))
    assert "a cycle took 1.2 s, longer than the period of 1 ms" in str(LawLate(spent_ns=1_200_000_000, period_s=0.001))
