"""Whether a correction pays for itself."""

from __future__ import annotations

import pytest

from positioner.laws.correction import STAYS_S, pays


@pytest.mark.parametrize(
    ("excursion_m", "number", "expected"),
    [
        (0.0249, 1, True),
        (0.0251, 1, False),
        (0.0124, 2, True),
        (0.0126, 2, False),
        (0.0249, 0, True),  # no move to this setpoint has ended yet
        (0.0, 7, True),  # straight there
    ],
)
def test_a_correction_pays_where_the_error_costs_more_than_the_excursion(
    excursion_m: float, number: int, expected: bool
) -> None:
    assert STAYS_S == 2.5
    assert pays(0.001, excursion_m, lasts_s=0.1, number=number) is expected
