"""The pictures of the robustness test."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.robustness.judgement import Bin, Distribution, Rate
from positioner.robustness.pictures import draw_factors

if TYPE_CHECKING:
    from pathlib import Path


def test_every_factor_has_a_panel_however_many_there_are(tmp_path: Path) -> None:
    found = Distribution(
        law="nmpc", dwells=200, mean_pct=0.2, quantiles_pct=(0.1, 1.0, 2.0, 3.0), worst_pct=4.0, overshoot_95_pct=1.0,
        settle_ratio=2.0, settle_ratio_95=3.0, moves=2.0, travel_ratio=1.1,
        lost=Rate(count=1, of=200), good_while_lost=0, failed=0,
    )  # fmt: skip
    names = [f"factor {number}" for number in range(25)]
    bins = [Bin(factor=name, low=low, high=low + 0.5, law=found, best=found) for name in names for low in (0.5, 1.0)]

    draw_factors(tmp_path / "factors.png", bins, "all factors")

    drawn = (tmp_path / "factors.svg").read_text(encoding="utf-8")
    assert [name for name in names if f">{name}<" not in drawn] == []
