"""Whether a correction pays for itself."""

from __future__ import annotations

import pytest

from positioner.laws.correction import STAYS_S, pays


@pytest.mark.parametrize(("excursion_m", "expected"), [(0.0149, True), (0.0151, False), (0.0, True)])
def test_a_correction_pays_where_the_error_costs_more_than_the_excursion(excursion_m: float, expected: bool) -> None:
    assert STAYS_S == 1.5
    assert pays(0.001, excursion_m, lasts_s=0.1) is expected
