"""Numbers, dates and ticks as a person reads them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_samples import MOMENT

from positioner.report import words
from positioner.report.scale import scale

THIN = "\N{NARROW NO-BREAK SPACE}"
MINUS = "\N{MINUS SIGN}"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (52538.4, f"52{THIN}538"),
        (1423.04, f"1{THIN}423"),
        (-54.153, f"{MINUS}54.15"),
        (0.0021, "0.002100"),
        (0.0, "0"),
        (None, "–"),
        (math.nan, "–"),
        (math.inf, "–"),
    ],
)
def test_a_number_has_four_digits(value: float | None, text: str) -> None:
    assert words.number(value) == text


def test_decimals_are_those_of_the_largest_and_nothing_is_minus_zero() -> None:
    assert words.number(-0.00003, 3) == "0"
    assert words.interval(-3.2, 2.7, 1) == f"{MINUS}3.2 to 2.7"
    assert words.interval(1.0, 1.0) == ""
    assert words.interval(None, None) == "–"


def test_a_change_has_a_sign_unless_it_is_none() -> None:
    assert words.change(1000.0, 1270.0) == f"+27.0{THIN}%"
    assert words.change(1000.0, 900.0) == f"{MINUS}10.0{THIN}%"
    assert words.change(1000.0, 1000.2) == f"0.0{THIN}%"
    assert words.change(0.0, 1.0) == words.change(1.0, None) == "–"
    assert words.date(MOMENT) == "9 Mar 2026, 14:05 UTC"


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=20), st.booleans())
def test_a_scale_holds_all_values_between_round_ends(values: list[float], from_zero: bool) -> None:
    found = scale(values, 50.0, 350.0, 5, from_zero=from_zero)
    assert found.low <= min(values) + 1e-6 * found.step
    assert found.high >= max(values) - 1e-6 * found.step
    assert 2 <= len(found.ticks) <= 9
    assert len({found.label(tick) for tick in found.ticks}) == len(found.ticks)
    assert found.at(found.low) == pytest.approx(50.0)
    assert found.at(found.high) == pytest.approx(350.0)
    if from_zero:
        assert found.low <= 0.0 <= found.high


def test_ticks_are_read_as_they_are_written() -> None:
    found = scale([0.0, 10.0], 0.0, 1.0, 4)
    assert [found.label(tick) for tick in found.ticks] == ["0.0", "2.5", "5.0", "7.5", "10.0"]
    assert [scale([-2000.0, 0.0], 0.0, 1.0, 2).label(tick) for tick in (-2000.0, 0.0)] == [f"{MINUS}2{THIN}000", "0"]
