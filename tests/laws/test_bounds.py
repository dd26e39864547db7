"""The movable bounds: eqs 21 to 28 of the paper, with its own example."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from positioner.errors import ConfigurationError
from positioner.inputs.toml_reader import build
from positioner.laws.paper.bounds import (
    ApproachForm,
    BoundSettings,
    approach_speed_limit_m_per_s,
    breakaway_bounds_ma,
    speed_bounds_m_per_s,
)

EXPONENTIAL = BoundSettings()
LINEAR = BoundSettings(approach_form=ApproachForm.LINEAR)
forms = st.sampled_from([EXPONENTIAL, LINEAR])
errors_m = st.floats(-0.14, 0.14)
speeds_m_per_s = st.floats(0.0, 2.0)
currents_ma = st.floats(-50.0, 50.0)


def test_equation_27_gives_the_papers_number() -> None:
    # the paper's numbers in its own units: an error of |1 - 0.03|, 0.04 cm/s, alpha 5, beta 150
    assert approach_speed_limit_m_per_s(EXPONENTIAL, 1.0 - 0.03, 0.04) == pytest.approx(5.04, abs=1e-9)


def test_in_centimetres_the_papers_example_is_saturated_and_in_si_it_brakes() -> None:
    # D6 of DESIGN.md: in cm, beta = 150 1/cm leaves 5.04 cm/s wherever the error exceeds half a millimetre
    centimetres = BoundSettings(approach_span_m_per_s=0.05, approach_decay_per_m=15000.0)
    for error_m in (0.0005, 0.0097):
        assert approach_speed_limit_m_per_s(centimetres, error_m, 0.0004) == pytest.approx(0.0504, rel=1e-3)
    # in SI the same example is 5 (1 - exp(-1.455)) m/s: a curve that falls over centimetres
    assert approach_speed_limit_m_per_s(EXPONENTIAL, 0.0097, 0.0004) == pytest.approx(3.8334, abs=1e-4)


@pytest.mark.parametrize("error_m", [0.02, -0.02])
def test_equation_22_rises_from_the_learned_speed_by_alpha(error_m: float) -> None:
    expected = 5.0 * (1.0 - math.exp(-150.0 * 0.02)) + 0.3
    assert approach_speed_limit_m_per_s(EXPONENTIAL, error_m, 0.3) == pytest.approx(expected)
    assert approach_speed_limit_m_per_s(EXPONENTIAL, 0.0, 0.3) == 0.3
    assert approach_speed_limit_m_per_s(EXPONENTIAL, 1e6, 0.3) == 5.3


@pytest.mark.parametrize("error_m", [0.02, -0.02])
def test_equation_21_rises_from_the_learned_speed_in_proportion(error_m: float) -> None:
    assert approach_speed_limit_m_per_s(LINEAR, error_m, 0.3) == pytest.approx(100.0 * 0.02 + 0.3)
    assert approach_speed_limit_m_per_s(LINEAR, 0.0, 0.3) == 0.3


def test_below_the_setpoint_the_bound_is_on_opening() -> None:
    # eqs 23 and 28: -V_min <= theta <= restVel
    limit = approach_speed_limit_m_per_s(EXPONENTIAL, 0.01, 0.3)
    assert speed_bounds_m_per_s(EXPONENTIAL, 0.01, 0.3) == (-10.0, limit)


@pytest.mark.parametrize("error_m", [-0.01, 0.0])
def test_at_or_above_the_setpoint_the_bound_is_on_closing(error_m: float) -> None:
    # eq. 24: -restVel <= theta <= V_max
    limit = approach_speed_limit_m_per_s(EXPONENTIAL, error_m, 0.3)
    assert speed_bounds_m_per_s(EXPONENTIAL, error_m, 0.3) == (-limit, 10.0)


def test_nothing_learned_leaves_the_speed_free() -> None:
    assert speed_bounds_m_per_s(EXPONENTIAL, 0.05, None) == (-10.0, 10.0)


@given(forms, errors_m, errors_m, speeds_m_per_s, speeds_m_per_s)
def test_the_limit_grows_with_the_error_and_with_the_learned_speed(
    settings: BoundSettings, one_m: float, other_m: float, slow: float, fast: float
) -> None:
    near, far = sorted((one_m, other_m), key=abs)
    slow, fast = sorted((slow, fast))
    lower = approach_speed_limit_m_per_s(settings, near, slow)
    assert lower <= approach_speed_limit_m_per_s(settings, far, slow)
    assert lower <= approach_speed_limit_m_per_s(settings, near, fast)
    assert lower >= slow


@given(forms, errors_m, speeds_m_per_s)
def test_both_directions_are_mirror_images(settings: BoundSettings, error_m: float, speed: float) -> None:
    low, high = speed_bounds_m_per_s(settings, abs(error_m) + 1e-9, speed)
    assert speed_bounds_m_per_s(settings, -abs(error_m) - 1e-9, speed) == (-high, -low)


@given(forms, errors_m, st.floats(0.0, 100.0))
def test_the_bound_never_exceeds_the_fastest_speed(settings: BoundSettings, error_m: float, speed: float) -> None:
    low, high = speed_bounds_m_per_s(settings, error_m, speed)
    assert -10.0 <= low <= 0.0 <= high <= 10.0
    assert low == -10.0 or high == 10.0


def test_a_bound_beyond_the_fastest_speed_is_the_fastest_speed() -> None:
    assert speed_bounds_m_per_s(EXPONENTIAL, 0.01, 50.0) == (-10.0, 10.0)


def test_breakaway_asks_for_at_least_gamma_to_open_and_at_most_gamma_to_close() -> None:
    # eqs 25 and 26
    assert breakaway_bounds_ma(0.01, 17.5, 4.0, 20.0) == (17.5, 20.0)
    assert breakaway_bounds_ma(-0.01, 7.5, 4.0, 20.0) == (4.0, 7.5)
    assert breakaway_bounds_ma(0.0, 7.5, 4.0, 20.0) == (4.0, 7.5)


def test_an_unknown_gamma_leaves_the_loop_as_it_is() -> None:
    assert breakaway_bounds_ma(0.01, None, 4.0, 20.0) == (4.0, 20.0)


@given(errors_m, currents_ma)
def test_gamma_never_leaves_the_loop(error_m: float, gamma_ma: float) -> None:
    low, high = breakaway_bounds_ma(error_m, gamma_ma, 4.0, 20.0)
    assert 4.0 <= low <= high <= 20.0
    assert (high if error_m > 0.0 else low) == (20.0 if error_m > 0.0 else 4.0)
    assert (low if error_m > 0.0 else high) == sorted((4.0, gamma_ma, 20.0))[1]


def test_an_unknown_form_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigurationError, match="'exponential' or 'linear'"):
        build({"approach_form": "quadratic"}, BoundSettings, "bounds")
