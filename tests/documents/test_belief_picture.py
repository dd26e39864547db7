"""The picture of the belief shows the valve that was played, and doubts that shrink."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from documents.belief import SHOWN, beliefs, draw, true_ma

if TYPE_CHECKING:
    from pathlib import Path


def test_what_is_drawn_is_believed_within_its_doubts_and_more_surely_than_what_is_configured() -> None:
    valve, found = beliefs()
    configured, *later = (found[number] for number in SHOWN)
    assert configured.balance_ma(0.08) == pytest.approx(valve.balance_current_ma(0.08))
    for place_m in (0.07, 0.09, 0.11):
        for direction in (1.0, -1.0):
            prior_ma2 = configured.numbers.variance((place_m, 1.0, direction, 0.0))
            for belief in later:
                mean_ma = belief.balance_ma(place_m) + direction * belief.sliding_ma
                variance_ma2 = belief.numbers.variance((place_m, 1.0, direction, 0.0))
                assert (mean_ma - true_ma(valve, place_m, direction)) ** 2 < 9.0 * variance_ma2
                assert variance_ma2 < 0.1 * prior_ma2


def test_the_picture_is_drawn(tmp_path: Path) -> None:
    draw(tmp_path / "belief.png")
    assert (tmp_path / "belief.png").read_bytes().startswith(b"\x89PNG")
