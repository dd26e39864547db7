"""The reason of a move: its text names the source of the breakaway current, and the source is read back from it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from positioner.laws.move_reason import Breakaway, BreakawaySource, MoveReason, source_in


def test_the_text_gives_error_current_and_source() -> None:
    assert str(MoveReason(1e-3, Breakaway(18.4, 4), 0.08)) == (
        "error +1.000 mm; breakaway 18.400 mA from the table (4 samples)"
    )
    assert str(MoveReason(-2e-3, Breakaway(7.25), 0.07)) == "error -2.000 mm; breakaway 7.250 mA from the model"


@given(st.floats(-0.1, 0.1), st.floats(-50.0, 50.0), st.integers(0, 10))
def test_the_source_is_read_back_from_the_text(error_m: float, current_ma: float, samples: int) -> None:
    source = source_in(str(MoveReason(error_m, Breakaway(current_ma, samples), 0.08)))
    assert source is (BreakawaySource.TABLE if samples else BreakawaySource.MODEL)


@pytest.mark.parametrize("text", ["", "no plan: the fastest inputs that keep the bound"])
def test_other_texts_name_no_source(text: str) -> None:
    assert source_in(text) is None
