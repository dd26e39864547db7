"""The lag of a position sensor, against an integration in small steps."""

from __future__ import annotations

import pytest

from positioner.valve.sensor import NO_LAG, sensor_lag


@pytest.mark.parametrize("lag_s", [1e-4, 2e-3, 0.02])
@pytest.mark.parametrize("period_s", [1e-3, 0.02])
def test_what_is_shown_of_an_even_motion_is_the_lag_of_all_of_it(lag_s: float, period_s: float) -> None:
    sensor, before_m, here_m, seen_m, steps = sensor_lag(lag_s, period_s), 0.07, 0.073, 0.0695, 200_000
    shown_m, step_s = seen_m, period_s / steps
    for step in range(steps):
        shown_m += step_s / lag_s * (before_m + (here_m - before_m) * (step + 0.5) / steps - shown_m)
    assert sensor.after(before_m, here_m, seen_m) == pytest.approx(shown_m, abs=1e-7)
    assert 0.0 < sensor.early < 0.5


def test_without_lag_a_reading_is_the_place_at_its_end() -> None:
    assert sensor_lag(0.0, 1e-3) == NO_LAG
    assert NO_LAG.after(0.07, 0.073, 0.0) == 0.073
