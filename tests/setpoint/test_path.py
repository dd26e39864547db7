"""The path of a setpoint: filter, rates, limits, tight shut-off; and no jump but that of the shut-off."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from positioner.setpoint.path import NEW_PATH, SetpointPath, followed
from positioner.setpoint.settings import Action, Characteristic, SetpointSettings
from positioner.valve.parameters import ValveParameters

VALVE = ValveParameters(id="paper")
SPAN_M = VALVE.span_m


def run(settings: SetpointSettings, asked_m: list[float], here_m: float = 0.0, step_s: float = 0.01) -> list[float]:
    """Return the setpoints that follow from what the host asks for, one after the other, in m."""
    path, found = NEW_PATH, []
    for each_m in asked_m:
        path, pursued_m = followed(settings, VALVE, path, each_m, here_m, step_s)
        found.append(pursued_m)
    return found


@given(asked=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20))
def test_without_functions_the_setpoint_is_the_hosts(asked: list[float]) -> None:
    asked_m = [each * SPAN_M for each in asked]
    assert not SetpointSettings().shapes
    assert run(SetpointSettings(), asked_m) == pytest.approx(asked_m, abs=1e-15)


def test_the_filter_is_a_first_order_lag_however_the_time_is_divided() -> None:
    settings = SetpointSettings(filter_s=0.5)
    for count in (1, 10, 100):
        end_m = run(settings, [SPAN_M] * count, 0.0, 1.0 / count)[-1]
        assert end_m == pytest.approx(SPAN_M * (1.0 - math.exp(-2.0)))


def test_the_rates_are_those_of_each_direction() -> None:
    settings = SetpointSettings(opening_per_s=0.2, closing_per_s=0.5)
    path = run(settings, [SPAN_M] * 100 + [0.0] * 30, 0.1 * SPAN_M)
    assert path[99] == pytest.approx(0.3 * SPAN_M)
    assert path[129] == pytest.approx(0.15 * SPAN_M)
    assert run(settings, [SPAN_M] * 1000)[-1] == SPAN_M


def test_a_new_path_begins_where_the_stem_is() -> None:
    settings = SetpointSettings(opening_per_s=0.1, action=Action.REVERSE)
    assert run(settings, [0.0], 0.4 * SPAN_M)[0] == pytest.approx(0.401 * SPAN_M)
    assert run(settings, [0.0], 1.08 * SPAN_M)[0] == SPAN_M


def test_the_limits_clip_the_travel_and_do_not_stretch_it() -> None:
    settings = SetpointSettings(travel_low=0.2, travel_high=0.9)
    asked = [0.0, 0.1, 0.2, 0.5, 0.9, 0.95, 1.0]
    found = run(settings, [each * SPAN_M for each in asked])
    assert found == pytest.approx([each * SPAN_M for each in (0.2, 0.2, 0.2, 0.5, 0.9, 0.9, 0.9)])


def test_shut_off_overrides_the_limits_and_ends_by_its_hysteresis() -> None:
    settings = SetpointSettings(travel_low=0.1, closed_below=0.02, open_above=0.97, hysteresis=0.01)
    asked = [0.1, 0.021, 0.02, 0.0, 0.029, 0.031, 0.5, 0.969, 0.971, 0.961, 0.959]
    found = run(settings, [each * SPAN_M for each in asked])
    expected = [0.1, 0.1, 0.0, 0.0, 0.0, 0.1, 0.5, 0.969, 1.0, 1.0, 0.959]
    assert found == pytest.approx([each * SPAN_M for each in expected])


@given(noise=st.lists(st.floats(-0.0049, 0.0049), min_size=50, max_size=50))
def test_a_setpoint_that_trembles_at_the_border_shuts_the_valve_once_at_most(noise: list[float]) -> None:
    settings = SetpointSettings(closed_below=0.02, hysteresis=0.01)
    path, changes = NEW_PATH, 0
    for each in noise:
        before = path.shut
        path, _ = followed(settings, VALVE, path, (0.02 + each) * SPAN_M, 0.5 * SPAN_M, 0.01)
        changes += path.shut != before
    assert changes <= 1


shaping = st.builds(
    SetpointSettings,
    action=st.sampled_from(Action),
    characteristic=st.sampled_from([each for each in Characteristic if each is not Characteristic.POINTS]),
    filter_s=st.sampled_from([0.0, 0.3]),
    opening_per_s=st.floats(0.01, 2.0),
    closing_per_s=st.floats(0.01, 2.0),
    travel_low=st.sampled_from([0.0, 0.15]),
    travel_high=st.sampled_from([0.8, 1.0]),
    closed_below=st.sampled_from([0.0, 0.02]),
)


@given(settings=shaping, asked=st.lists(st.floats(-0.1, 1.1), min_size=2, max_size=30), here=st.floats(0.0, 1.0))
def test_behind_a_rate_nothing_jumps_but_at_a_shut_off(
    settings: SetpointSettings, asked: list[float], here: float
) -> None:
    path: SetpointPath = NEW_PATH
    before_m, was_shut = None, 0
    for each in asked:
        path, pursued_m = followed(settings, VALVE, path, each * SPAN_M, here * SPAN_M, 0.05)
        if before_m is not None and path.shut == was_shut:
            step = (pursued_m - before_m) / SPAN_M
            assert -settings.closing_per_s * 0.05 - 1e-12 <= step <= settings.opening_per_s * 0.05 + 1e-12
        before_m, was_shut = pursued_m, path.shut
        assert 0.0 <= pursued_m <= SPAN_M


def test_the_words_name_what_is_on_in_its_order() -> None:
    assert SetpointSettings().in_words() == "as the host sends it"
    settings = SetpointSettings(
        signal_high=0.5,
        action=Action.REVERSE,
        characteristic=Characteristic.EQUAL_PERCENTAGE,
        filter_s=0.5,
        opening_per_s=0.1,
        travel_low=0.05,
        closed_below=0.005,
        open_above=0.995,
    )
    assert settings.in_words() == (
        "split range 0 to 0.5 of the signal, reverse action, equal percentage (R = 50), filter 0.5 s, "
        "opening at most 10 %/s, travel 5 to 100 %, tight shut-off at 0.5 %, fully open from 99.5 %"
    )
    quick = SetpointSettings(characteristic=Characteristic.QUICK_OPENING)
    assert quick.in_words() == "quick opening"
