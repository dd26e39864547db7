"""The pressure under a steady current and the deadbeat command, against an integration of the actuator's equations."""

from __future__ import annotations

import math

import pytest
from actuator_reference import actuator_of, pressure_rate
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from positioner.valve.actuator import ActuatorParameters
from positioner.valve.course import lags_of
from positioner.valve.drive import drive_of

lagging = st.builds(
    actuator_of,
    st.sampled_from((0.002, 0.02, 0.1)),
    st.sampled_from((1.0, 0.6, 1.65)),
    st.sampled_from((0.0, 0.005, 0.02, 0.020002)),
    st.sampled_from((0.0, 40.0, 300.0)),
)
with_converter_only = ActuatorParameters(converter_time_constant_s=0.01)
loop_ma = st.floats(4.0, 20.0)
durations_s = st.sampled_from((1e-3, 1e-2, 0.1))


def integrated(actuator: ActuatorParameters, p: float, w: float, u: float, duration_s: float) -> tuple[float, float]:
    converter_s = actuator.converter_time_constant_s

    def rates(_t: float, state: tuple[float, float]) -> tuple[float, float]:
        p, w = state
        return pressure_rate(actuator, p, w if converter_s else u), (u - w) / converter_s if converter_s else 0.0

    run = solve_ivp(rates, (0.0, duration_s), (p, w), method="LSODA", rtol=1e-9, atol=1e-10, max_step=duration_s / 50)
    return float(run.y[0, -1]), float(run.y[1, -1]) if converter_s else u


@settings(max_examples=60)
@given(lagging | st.just(with_converter_only), loop_ma, loop_ma, loop_ma, durations_s)
@example(actuator_of(0.02, 1.0, 0.005, 300.0), 16.9284, 17.9284, 4.0, 0.01)  # the limit acts after w crosses p
@example(actuator_of(0.02, 1.0, 0.02, 0.0), 10.0, 5.0, 19.0, 0.01)  # two equal lags
def test_the_course_is_that_of_the_equations(
    actuator: ActuatorParameters, p: float, w: float, u: float, duration_s: float
) -> None:
    pieces = lags_of(actuator).course(p, w, u, duration_s)
    expected_p, expected_w = integrated(actuator, p, w, u, duration_s)
    assert pieces[-1].pressure_ma(pieces[-1].duration_s) == pytest.approx(expected_p, abs=1e-4)
    assert math.fsum(piece.duration_s for piece in pieces) == pytest.approx(duration_s, rel=1e-9)
    begin = p
    for piece in pieces:
        assert piece.pressure_ma(0.0) == pytest.approx(begin, abs=1e-6)
        begin = piece.pressure_ma(piece.duration_s)
    drive = drive_of(actuator, duration_s, 4.0, 20.0)
    assert drive.after(p, w, u) == pytest.approx((begin, expected_w), abs=1e-5)


@given(loop_ma, loop_ma, loop_ma)
def test_without_a_lag_the_pressure_is_the_current_to_the_bit(p: float, w: float, u: float) -> None:
    drive = drive_of(ActuatorParameters(), 1e-3, 4.0, 20.0)
    (piece,) = drive.course(p, w, u)
    assert (piece.steady_ma, piece.slope_ma_per_s, piece.near_ma, piece.far_ma) == (u, 0.0, 0.0, 0.0)
    assert drive.after(p, w, u) == (u, u)
    assert drive.command_ma(p, w, u) == u


@given(
    st.builds(actuator_of, st.sampled_from((0.002, 0.1)), st.just(0.6), st.just(0.0), st.sampled_from((0.0, 40.0))),
    loop_ma,
    loop_ma,
    st.sampled_from((1e-3, 1e-2)),
)
def test_the_deadbeat_command_arrives_in_one_sample_or_is_as_fast_as_the_limits_allow(
    actuator: ActuatorParameters, p: float, wanted_ma: float, period_s: float
) -> None:
    drive = drive_of(actuator, period_s, 4.0, 20.0)
    current_ma = drive.command_ma(p, p, wanted_ma)
    assert 4.0 <= current_ma <= 20.0
    arrived, _ = drive.after(p, p, current_ma)
    if abs(arrived - wanted_ma) > 1e-9:
        limit_ma = 20.0 if wanted_ma > p else 4.0
        fastest, _ = drive.after(p, p, limit_ma)
        assert arrived == pytest.approx(fastest, abs=1e-9)
        assert abs(arrived - p) < abs(wanted_ma - p)


@pytest.mark.parametrize("converter_s", [0.005, 0.02])
@pytest.mark.parametrize("lag_s", [0.0, 0.02, 0.1])
def test_behind_a_converter_the_deadbeat_commands_arrive_soon_and_go_little_beyond(
    lag_s: float, converter_s: float
) -> None:
    drive = drive_of(actuator_of(lag_s, 1.0, converter_s, 0.0), 1e-3, 4.0, 20.0)
    p = w = 10.0
    highest = p
    for _ in range(round((0.02 + 2.5 * converter_s + lag_s) / 1e-3)):
        p, w = drive.after(p, w, drive.command_ma(p, w, 12.0))
        highest = max(highest, p)
    assert p == pytest.approx(12.0, abs=0.05)
    assert highest < 12.1


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("actuator", [actuator_of(0.05, 0.6, 0.0, 0.0), actuator_of(0.05, 1.0, 0.01, 40.0)])
def test_the_ramp_command_keeps_a_ramp_going(actuator: ActuatorParameters, direction: float) -> None:
    drive = drive_of(actuator, 1e-3, 4.0, 20.0)
    _, w = drive.ramp_ma(10.0, direction, 8.0)
    p = 10.0
    for _ in range(20):
        before = p
        p, w = drive.after(p, w, drive.ramp_ma(p, direction, 8.0)[0])
        assert direction * (p - before) == pytest.approx(8e-3, rel=0.1)
