"""Corrections: the closed form of a normal distribution, and durations that were measured in closed loops."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from positioner.config.reader import parse_config
from positioner.reach.case import Case
from positioner.reach.corrections import corrections
from positioner.reach.figures import figures_of
from positioner.reach.small_moves import smallest_jump

LOW_NOISE, TWO_PERCENT = (0.0, 0.0005), (0.02, 0.0)


def case_of(lag_ms: float, noise: tuple[float, float]) -> Case:
    lags = f"[valve.actuator]\nfill_time_constant_s = {lag_ms * 1e-3}\nvent_time_constant_s = {lag_ms * 1e-3}\n"
    sensor = f"[estimator]\nnoise_of_reading = {noise[0]}\nnoise_of_span = {noise[1]}\n"
    return Case.of(parse_config(f'[valve]\nid = "v"\npreset = "paper"\n{lags}{sensor}', "valve.toml", Path()))


# `python -m benchmarks.reach_durations`: median and mean in ms, the part of the moves that was corrected
@pytest.mark.parametrize(
    ("lag_ms", "noise", "median_ms", "mean_ms", "share"),
    [
        (0.0, LOW_NOISE, 8.0, 8.0, 0.0),
        (2.0, LOW_NOISE, 17.0, 17.0, 0.0),
        (10.0, LOW_NOISE, 24.0, 26.0, 0.03),
        (50.0, LOW_NOISE, 69.0, 79.0, 0.07),
        (300.0, LOW_NOISE, 349.0, 367.0, 0.03),
        (0.0, TWO_PERCENT, 8.0, 8.0, 0.0),
        (5.0, TWO_PERCENT, 20.0, 213.0, 0.43),
        (20.0, TWO_PERCENT, 35.0, 192.0, 0.40),
        (50.0, TWO_PERCENT, 70.0, 240.0, 0.30),
        (100.0, TWO_PERCENT, 126.0, 445.0, 0.33),
        (300.0, TWO_PERCENT, 350.0, 562.0, 0.13),
    ],
)
def test_durations_and_corrections_are_those_of_closed_loops(
    lag_ms: float, noise: tuple[float, float], median_ms: float, mean_ms: float, share: float
) -> None:
    found = figures_of(case_of(lag_ms, noise))
    assert found.law_s * 1e3 == pytest.approx(median_ms, rel=0.2)
    assert found.mean_s * 1e3 == pytest.approx(mean_ms, rel=0.31)
    assert found.share == pytest.approx(share, abs=0.08)
    assert found.mean_s == pytest.approx(found.law_s + found.share * found.correction_s)
    assert 1.0 < found.moves < 2.0


def test_the_part_that_is_corrected_is_that_of_a_normal_distribution() -> None:
    case = case_of(20.0, TWO_PERCENT)
    jump = smallest_jump(case, 1.0)
    sigma_m = math.hypot(0.12 * 284.7 / 52538.0, 2.7 * jump.landing_m)
    inside = math.erf(1.27e-3 / (sigma_m * math.sqrt(2.0)))
    assert corrections(case, jump).share == pytest.approx(1.0 - inside, rel=1e-9)


def test_a_step_aside_costs_two_moves_and_is_made_where_the_jump_is_longer_than_the_error() -> None:
    # at 20 ms of lag the jump that the readings show is 0.9 mm, at 50 ms 1.4 mm; errors of 1.3 mm are corrected
    cases = [case_of(lag_ms, LOW_NOISE) for lag_ms in (0.0, 20.0, 50.0)]
    at_once, direct, aside = [corrections(case, smallest_jump(case, 1.0)) for case in cases]
    assert direct.correction_s < 0.05
    assert aside.correction_s > 0.15
    assert at_once.share < 1e-9
