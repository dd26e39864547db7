"""Slow sliding in a case with a closed form: a decaying force on a free mass, with a flat curve."""

from __future__ import annotations

import math

import pytest
from scipy.optimize import brentq

from plant_emulator.force import PushingForce
from plant_emulator.segment import Ending
from plant_emulator.stribeck import StribeckSlide

RATE = 100.0


def free(sign: int = 1) -> StribeckSlide:
    """Return the slide of a mass of 1 kg, which a decaying force first slows and a constant one then speeds up."""
    force = PushingForce(sign * 1.0, ((-sign * 3.0, RATE),))
    return StribeckSlide(
        force=force, sign=sign, mass_kg=1.0, spring_n_per_m=1e-9, viscous_n_s_per_m=0.0, load_n=0.0, drop_n=0.0,
        stribeck_velocity_m_per_s=0.1,
    )  # fmt: skip


def speed(start: float, t: float) -> float:
    return start + t - 3.0 / RATE * (1.0 - math.exp(-RATE * t))


def way(start: float, t: float) -> float:
    return start * t + 0.5 * t * t - 3.0 / RATE * (t - (1.0 - math.exp(-RATE * t)) / RATE)


LOWEST_S = math.log(3.0) / RATE


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("margin", [1e-3, 1e-6, 1e-9])
def test_a_brief_dip_of_the_speed_below_its_bound_is_found(sign: int, margin: float) -> None:
    low = speed(0.05, LOWEST_S) + margin
    segment = free(sign).run(0.0, sign * 0.05, 1.0, low, 10.0, sign * 9.0)
    assert segment.ending is Ending.SPEED
    assert segment.duration_s == pytest.approx(brentq(lambda t: speed(0.05, t) - low, 0.0, LOWEST_S), abs=1e-8)
    assert segment.position_m == pytest.approx(sign * way(0.05, segment.duration_s), abs=1e-12)
    assert segment.velocity_m_per_s == sign * low


@pytest.mark.parametrize("sign", [1, -1])
def test_a_dip_that_stays_above_the_bound_is_no_event(sign: int) -> None:
    low = speed(0.05, LOWEST_S) - 1e-6
    segment = free(sign).run(0.0, sign * 0.05, 0.1, low, 10.0, sign * 9.0)
    assert segment.ending is Ending.OPEN
    assert segment.duration_s == 0.1
    assert segment.velocity_m_per_s == pytest.approx(sign * speed(0.05, 0.1), abs=1e-11)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_border_is_met_before_the_dip_behind_it(sign: int) -> None:
    border = sign * way(0.05, 0.5 * LOWEST_S)
    segment = free(sign).run(0.0, sign * 0.05, 1.0, speed(0.05, LOWEST_S) + 1e-6, 10.0, border)
    assert segment.ending is Ending.BORDER
    assert segment.position_m == border
    assert segment.duration_s == pytest.approx(0.5 * LOWEST_S, abs=1e-10)
    assert segment.velocity_m_per_s == pytest.approx(sign * speed(0.05, segment.duration_s), abs=1e-11)


def test_a_fast_stem_ends_slow_sliding() -> None:
    segment = free().run(0.0, 0.05, 10.0, 0.0, 0.5, 99.0)
    assert segment.ending is Ending.OPEN
    assert segment.velocity_m_per_s >= 0.5
    assert segment.velocity_m_per_s == pytest.approx(speed(0.05, segment.duration_s), rel=1e-9)
