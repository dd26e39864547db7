"""The reason of a move: its text names the breakaway current, which is read back from it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from positioner.laws.move_reason import MoveReason, current_in


def test_the_text_gives_error_and_current() -> None:
    assert str(MoveReason(1e-3, 18.4, 0.08)) == "error +1.000 mm; breakaway 18.400 mA"
    assert str(MoveReason(-2e-3, 7.25, 0.07)) == "error -2.000 mm; breakaway 7.250 mA"


@given(st.floats(-0.1, 0.1), st.floats(-50.0, 50.0))
def test_the_current_is_read_back_from_the_text(error_m: float, current_ma: float) -> None:
    assert current_in(str(MoveReason(error_m, current_ma, 0.08))) == pytest.approx(current_ma, abs=0.0005001)


@pytest.mark.parametrize("source", ["the model", "the table (4 samples)"])
def test_the_current_is_read_from_a_trace_of_an_earlier_version(source: str) -> None:
    assert current_in(f"error -2.000 mm; breakaway 18.400 mA from {source}") == 18.4


@pytest.mark.parametrize("text", ["", "no plan: the fastest inputs that keep the bound"])
def test_other_texts_name_no_current(text: str) -> None:
    assert current_in(text) is None
