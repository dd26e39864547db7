"""The pressure behind a lagging converter and a slew limit: closed forms, and independence of the steps."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from plant_emulator.chamber import phases
from plant_emulator.parameters import ActuatorSettings

START_PA, TARGET_PA = 20e3, 60e3


def pressures(
    settings: ActuatorSettings, target_pa: float, duration_s: float, start: Any = None
) -> tuple[float, float]:
    """Return the pressures of chamber and converter after `duration_s`, from `start` or from balance."""
    chamber_pa, converter_pa = start or (START_PA, START_PA)
    found, chamber_pa, converter_pa = phases(settings, chamber_pa, converter_pa, target_pa, duration_s)
    assert sum(phase.duration_s for phase in found) == pytest.approx(duration_s, rel=1e-12)
    assert len(found) <= 5
    return chamber_pa, converter_pa


@pytest.mark.parametrize("t", [1e-5, 2e-3, 0.01, 0.1])
def test_two_lags_give_the_step_response_of_second_order(t: float) -> None:
    lags = ActuatorSettings(fill_time_constant_s=0.02, vent_time_constant_s=0.02, converter_time_constant_s=0.005)
    part = 1.0 - (0.02 * math.exp(-t / 0.02) - 0.005 * math.exp(-t / 0.005)) / (0.02 - 0.005)
    chamber_pa, converter_pa = pressures(lags, TARGET_PA, t)
    assert chamber_pa == pytest.approx(START_PA + part * (TARGET_PA - START_PA), abs=1e-6)
    assert converter_pa == pytest.approx(TARGET_PA + (START_PA - TARGET_PA) * math.exp(-t / 0.005), abs=1e-6)


@pytest.mark.parametrize("t", [2e-3, 0.01, 0.1])
def test_two_equal_lags_give_the_critical_response(t: float) -> None:
    lags = ActuatorSettings(fill_time_constant_s=0.01, vent_time_constant_s=0.01, converter_time_constant_s=0.01)
    part = 1.0 - (1.0 + t / 0.01) * math.exp(-t / 0.01)
    # equal lags count as one hundredth of a percent apart
    assert pressures(lags, TARGET_PA, t)[0] == pytest.approx(START_PA + part * (TARGET_PA - START_PA), abs=2.0)


def test_a_converter_lag_alone_is_a_lag_of_the_chamber() -> None:
    chamber_pa, converter_pa = pressures(ActuatorSettings(converter_time_constant_s=0.01), TARGET_PA, 0.013)
    assert chamber_pa == converter_pa == pytest.approx(TARGET_PA + (START_PA - TARGET_PA) * math.exp(-1.3), rel=1e-12)


def test_a_slew_limit_alone_gives_a_ramp_that_ends_at_the_target() -> None:
    limited = ActuatorSettings(slew_pa_per_s=1e6)
    assert pressures(limited, TARGET_PA, 0.03)[0] == pytest.approx(START_PA + 0.03 * 1e6, rel=1e-12)
    assert pressures(limited, TARGET_PA, 0.05)[0] == pytest.approx(TARGET_PA, rel=1e-12)
    assert pressures(limited, 5e3, 0.01)[0] == pytest.approx(START_PA - 0.01 * 1e6, rel=1e-12)


@pytest.mark.parametrize(("target_pa", "lag_s"), [(TARGET_PA, 0.02), (2e3, 0.008)])
def test_a_limited_lag_ramps_and_then_settles_from_where_the_lag_alone_is_as_slow(
    target_pa: float, lag_s: float
) -> None:
    limited = ActuatorSettings(fill_time_constant_s=0.02, vent_time_constant_s=0.008, slew_pa_per_s=1e6)
    way = math.copysign(1.0, target_pa - START_PA)
    ramp_s = (abs(target_pa - START_PA) - 1e6 * lag_s) / 1e6
    assert pressures(limited, target_pa, 0.9 * ramp_s)[0] == pytest.approx(START_PA + way * 0.9e6 * ramp_s, rel=1e-12)
    settled_pa = target_pa - way * 1e6 * lag_s * math.exp(-0.011 / lag_s)
    assert pressures(limited, target_pa, ramp_s + 0.011)[0] == pytest.approx(settled_pa, rel=1e-12)


def test_a_converter_that_lags_passes_the_chamber_where_filling_begins() -> None:
    # the converter starts below the chamber: it vents with 4 ms, then fills with 20 ms
    lags = ActuatorSettings(fill_time_constant_s=0.02, vent_time_constant_s=0.004, converter_time_constant_s=0.01)
    found, chamber_pa, _ = phases(lags, 40e3, START_PA, TARGET_PA, 0.03)
    assert len(found) == 2
    turn_s = found[0].duration_s
    meets_pa = TARGET_PA + (START_PA - TARGET_PA) * math.exp(-turn_s / 0.01)
    assert found[0].at(turn_s) == pytest.approx(meets_pa, rel=1e-9)
    rest_s = 0.03 - turn_s
    far_pa = TARGET_PA - meets_pa
    part = (0.02 * math.exp(-rest_s / 0.02) - 0.01 * math.exp(-rest_s / 0.01)) / (0.02 - 0.01)
    assert chamber_pa == pytest.approx(TARGET_PA - far_pa * part, rel=1e-9)


lags_s = st.sampled_from([0.0, 0.001, 0.00500001, 0.005, 0.02, 0.3])
actuators = st.builds(
    lambda fill_s, vent_s, converter_s, slew: ActuatorSettings(
        fill_time_constant_s=fill_s,
        vent_time_constant_s=vent_s,
        converter_time_constant_s=converter_s,
        slew_pa_per_s=slew,
    ),
    lags_s,
    lags_s,
    lags_s,
    st.sampled_from([0.0, 1e5, 1e6, 3e7]),
)
targets = st.lists(
    st.tuples(st.one_of(st.just(2.2e-16), st.floats(0.0, 1e5)), st.floats(1e-4, 0.1)), min_size=1, max_size=8
)


@settings(max_examples=300)
@given(actuators, targets, st.integers(2, 40))
def test_no_cut_of_time_changes_the_pressure(
    actuator: ActuatorSettings, sequence: list[tuple[float, float]], pieces: int
) -> None:
    whole = cut = (START_PA, START_PA)
    for target_pa, duration_s in sequence:
        whole = pressures(actuator, target_pa, duration_s, whole)
        for _ in range(pieces):
            cut = pressures(actuator, target_pa, duration_s / pieces, cut)
        assert cut == pytest.approx(whole, abs=1e-3)  # a step of the pressure is some 1e5 Pa


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([0.004, 0.02]),
    st.sampled_from([0.004, 0.013]),
    st.sampled_from([0.003, 0.015]),
    st.sampled_from([0.0, 4e5, 1.5e6]),
    targets,
)
def test_the_pressure_agrees_with_an_independent_integration(
    fill_s: float, vent_s: float, converter_s: float, slew: float, sequence: list[tuple[float, float]]
) -> None:
    actuator = ActuatorSettings(
        fill_time_constant_s=fill_s, vent_time_constant_s=vent_s, converter_time_constant_s=converter_s,
        slew_pa_per_s=slew,
    )  # fmt: skip

    def rates(_t: float, y: list[float], target_pa: float) -> list[float]:
        chamber_pa, converter_pa = y
        rate = (converter_pa - chamber_pa) / (fill_s if converter_pa > chamber_pa else vent_s)
        return [min(max(rate, -slew), slew) if slew else rate, (target_pa - converter_pa) / converter_s]

    ours = theirs = (START_PA, START_PA)
    for target_pa, duration_s in sequence:
        ours = pressures(actuator, target_pa, duration_s, ours)
        run = solve_ivp(rates, (0.0, duration_s), theirs, args=(target_pa,), rtol=1e-10, atol=1e-6, max_step=1e-3)
        theirs = (float(run.y[0, -1]), float(run.y[1, -1]))
        assert ours == pytest.approx(theirs, abs=0.05)
