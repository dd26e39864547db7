"""The pressure behind dead time, converter, slew limit and lag, against closed forms and SciPy's integrator."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from scipy.integrate import solve_ivp

from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters
from positioner.valve.pressure import PressureModel, pressure_model

if TYPE_CHECKING:
    import numpy as np

PERIOD_S = 1e-3


def model_of(period_s: float = PERIOD_S, delay_s: float = 0.0, **actuator: float) -> PressureModel:
    valve = ValveParameters(id="x", actuator=ActuatorParameters(**actuator))
    return pressure_model(valve.actuator, period_s, delay_s)


def played(model: PressureModel, begin_ma: float, currents_ma: list[float]) -> list[float]:
    state, found = model.at_rest(begin_ma), []
    for current_ma in currents_ma:
        state = model.after(state, current_ma)
        found.append(state.pressure_ma)
    return found


def test_without_lag_the_pressure_is_the_current() -> None:
    assert played(model_of(), 8.0, [12.0, 5.0, 20.0]) == [12.0, 5.0, 20.0]


@pytest.mark.parametrize(
    ("dead_s", "delay_s", "expected"),
    [
        (0.003, 0.0, [8.0, 8.0, 8.0, 12.0, 20.0]),
        (0.0025, 0.0, [8.0, 8.0, 10.0, 16.0, 20.0]),  # half of a sample each
        (0.002, 0.001, [8.0, 8.0, 8.0, 12.0, 20.0]),
        (0.00025, 0.0, [11.0, 18.0, 20.0, 20.0, 20.0]),
    ],
)
def test_a_dead_time_is_waited_for_in_parts_of_samples(dead_s: float, delay_s: float, expected: list[float]) -> None:
    currents_ma = [12.0, 20.0, 20.0, 20.0, 20.0]
    assert played(model_of(delay_s=delay_s, dead_time_s=dead_s), 8.0, currents_ma) == pytest.approx(expected, abs=1e-9)
    other = model_of(delay_s=delay_s, dead_time_s=0.01).with_dead_time(dead_s)
    assert played(other, 8.0, currents_ma) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("dead_s", "expected"), [(0.001, [14.0, 20.0, 20.0, 20.0]), (0.004, [8.0, 8.0, 12.0, 14.0])])
def test_the_state_of_another_dead_time_goes_on_with_the_commands_that_are_known(
    dead_s: float, expected: list[float]
) -> None:
    model = model_of(dead_time_s=0.002)
    state = model.at_rest(8.0)
    for current_ma in (12.0, 14.0):
        state = model.after(state, current_ma)
    other, found = model.with_dead_time(dead_s), []
    for _ in expected:
        state = other.after(state, 20.0)
        found.append(state.pressure_ma)
    assert found == expected


@pytest.mark.parametrize(("to_ma", "lag_s"), [(16.0, 0.05), (4.0, 0.08)])
def test_a_lag_is_an_exponential_one_for_filling_and_one_for_venting(to_ma: float, lag_s: float) -> None:
    model = model_of(fill_time_constant_s=0.05, vent_time_constant_s=0.08)

    found = played(model, 10.0, [to_ma] * 40)

    expected = [to_ma + (10.0 - to_ma) * math.exp(-(number + 1) * PERIOD_S / lag_s) for number in range(40)]
    assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("period_s", [1e-3, 5e-3, 2e-2])
@pytest.mark.parametrize("slew_ma_per_s", [0.0, 60.0])
def test_converter_slew_limit_and_lag_together_follow_the_equations(period_s: float, slew_ma_per_s: float) -> None:
    lags = {"converter_time_constant_s": 0.02, "fill_time_constant_s": 0.1, "vent_time_constant_s": 0.06}
    limit = slew_ma_per_s or math.inf

    def rates(_time: float, state: np.ndarray) -> list[float]:
        converter_ma, pressure_ma = state
        gap_ma = converter_ma - pressure_ma
        rate = gap_ma / (0.1 if gap_ma > 0.0 else 0.06)
        return [(18.0 - converter_ma) / 0.02, min(max(rate, -limit), limit)]

    count = round(0.3 / period_s)
    exact = solve_ivp(rates, (0.0, 0.3), [6.0, 6.0], rtol=1e-9, atol=1e-9, max_step=1e-3, dense_output=True)
    found = played(model_of(period_s, **lags, slew_ma_per_s=slew_ma_per_s), 6.0, [18.0] * count)

    expected = [float(exact.sol((number + 1) * period_s)[1]) for number in range(count)]
    # the output of the converter goes evenly within a step; held at its end it would come too early, by 0.25 mA
    assert max(abs(one - other) for one, other in zip(found, expected, strict=True)) < 0.02
    assert found[-1] == pytest.approx(expected[-1], abs=0.002)


@pytest.mark.parametrize("times", [0.5, 1.6, 3.0])
@pytest.mark.parametrize(("to_ma", "lag_s"), [(16.0, 0.05), (4.0, 0.08)])
def test_a_lag_that_is_so_many_times_as_long_is_the_exponential_of_that_lag(
    times: float, to_ma: float, lag_s: float
) -> None:
    model = model_of(fill_time_constant_s=0.05, vent_time_constant_s=0.08).with_lag(0.05 * times)

    found = played(model, 10.0, [to_ma] * 40)

    expected = [to_ma + (10.0 - to_ma) * math.exp(-(number + 1) * PERIOD_S / (times * lag_s)) for number in range(40)]
    assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("times", [0.7, 1.6])
@pytest.mark.parametrize("slew_ma_per_s", [0.0, 60.0])
def test_all_lags_change_in_proportion_and_slew_limit_and_dead_time_stay(times: float, slew_ma_per_s: float) -> None:
    # of lags that are so long a sample has one step
    lags = {"fill_time_constant_s": 0.1, "vent_time_constant_s": 0.06, "converter_time_constant_s": 0.04}
    others = {"dead_time_s": 0.004, "slew_ma_per_s": slew_ma_per_s}
    scaled = model_of(5e-3, **lags, **others).with_lag(times * 0.14)
    configured = model_of(5e-3, **{key: times * lag_s for key, lag_s in lags.items()}, **others)
    currents_ma = [18.0] * 30 + [5.0] * 30

    assert played(scaled, 10.0, currents_ma) == pytest.approx(played(configured, 10.0, currents_ma), rel=1e-9)


def test_a_valve_without_lag_may_be_given_one_and_one_with_lags_none() -> None:
    lags = {"fill_time_constant_s": 0.03, "vent_time_constant_s": 0.03}
    currents_ma = [12.0, 5.0, 20.0]
    assert played(model_of().with_lag(0.0), 8.0, currents_ma) == currents_ma
    assert played(model_of(converter_time_constant_s=0.02, **lags).with_lag(0.0), 8.0, currents_ma) == currents_ma
    assert played(model_of().with_lag(0.03), 8.0, currents_ma) == played(model_of(**lags), 8.0, currents_ma)
