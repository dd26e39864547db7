"""The slide under a changing pressure, and its predicted stop: against an integration, `motion.step`, differences."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from actuator_reference import Moving, actuator_of, moved
from hypothesis import example, given, settings
from hypothesis import strategies as st

from positioner.valve.actuator import ActuatorParameters
from positioner.valve.brake import Brake
from positioner.valve.course import Piece
from positioner.valve.drive import drive_of
from positioner.valve.driven_slide import driven_slide
from positioner.valve.motion import Load, MotionModel
from positioner.valve.parameters import ValveParameters

if TYPE_CHECKING:
    from positioner.valve.brake import Stop

VALVE = ValveParameters(id="paper")
MODEL = MotionModel.of(VALVE)
NOMINAL = Load.of(VALVE)
CRITICAL_N_S_PER_M = 2.0 * math.sqrt(VALVE.mass_kg * VALVE.spring_rate_n_per_m)
POLE_S = VALVE.mass_kg * 2.0 / CRITICAL_N_S_PER_M
"""Time constant of both poles of the stem with critical damping."""

loads = st.builds(
    Load,
    st.floats(4e4, 7e4),
    st.floats(300.0, 2000.0),
    st.floats(150.0, 1200.0) | st.just(CRITICAL_N_S_PER_M) | st.just(70000.0),
)
light_loads = st.builds(Load, st.floats(4e4, 7e4), st.floats(300.0, 2000.0), st.floats(150.0, 1200.0))
actuators = st.builds(
    actuator_of,
    st.sampled_from((0.0, 1e-5, 0.003, 0.00868, 0.02, 0.3)),
    st.sampled_from((1.0, 0.6, 1.65)),
    st.sampled_from((0.0, 0.0, 0.005, 0.015)),
    st.sampled_from((0.0, 0.0, 40.0, 300.0)),
)
brakings = st.sampled_from((-0.4, 0.3, 0.9))
slow_actuators = st.just(ActuatorParameters()) | st.builds(
    actuator_of,
    st.sampled_from((0.003, 0.00868, 0.02, 0.3)),
    st.sampled_from((1.0, 0.6)),
    st.sampled_from((0.0, 0.0, 0.01)),
    st.sampled_from((0.0, 0.0, 40.0)),
)
signs = st.sampled_from((1.0, -1.0))


def brake_of(actuator: ActuatorParameters, load: Load, s: float, period_s: float = 1e-3) -> Brake:
    return Brake(driven_slide(MODEL, load, s), drive_of(actuator, period_s, 4.0, 20.0))


def pushing_ma(load: Load, s: float, x: float, part: float) -> float:
    """Return the pressure that pushes with `part` of the friction."""
    return MODEL.current_ma(load.spring_n_per_m * x + s * part * load.friction_n)


@settings(max_examples=60, deadline=None)
@given(actuators, loads, signs, st.floats(0.06, 0.09), st.floats(0.0, 0.4), st.floats(1.01, 1.5), st.floats(4.0, 20.0))
@example(actuator_of(POLE_S, 1.0, 0.0, 0.0), Load(52538.0, 1423.0, CRITICAL_N_S_PER_M), 1.0, 0.08, 0.1, 1.2, 5.0)
@example(actuator_of(0.02, 1.0, POLE_S, 0.0), Load(52538.0, 1423.0, CRITICAL_N_S_PER_M), -1.0, 0.08, 0.1, 1.2, 18.0)
def test_a_sample_is_that_of_the_equations(
    actuator: ActuatorParameters, load: Load, s: float, x: float, speed: float, push: float, u: float
) -> None:
    p = pushing_ma(load, s, x, push)
    start = Moving(x, s * speed, p, p + s)
    found = brake_of(actuator, load, s, 5e-3).after(*start[:4], u)
    if not actuator.fill_time_constant_s and not actuator.converter_time_constant_s and not actuator.slew_ma_per_s:
        assert found[0] == MODEL.step(x, s * speed, u, load, s, 5e-3).x
        if not speed and s * MODEL.push_n(u, s, load.friction_n) <= s * load.spring_n_per_m * x:
            return  # the reference lets a stem at rest turn
    expected = moved(MODEL, load, actuator, s, start, u, 5e-3)
    assert found[0] == pytest.approx(expected.x, abs=1e-7)
    assert found[1] == pytest.approx(expected.v, abs=2e-5)
    assert found[2:4] == pytest.approx((expected.p, expected.w), abs=1e-5)
    if abs(expected.v) > 1e-4:
        assert not found[4]


@given(loads, signs, st.floats(0.06, 0.09), st.floats(0.0, 0.4), st.floats(4.0, 20.0), st.sampled_from((1e-3, 0.05)))
def test_under_a_steady_pressure_it_is_the_motion_of_the_valve_without_lag_to_the_bit(
    load: Load, s: float, x: float, speed: float, u: float, duration_s: float
) -> None:
    found = driven_slide(MODEL, load, s).along(Piece(duration_s, u), x, s * speed)
    expected = MODEL.step(x, s * speed, u, load, s, duration_s)
    assert (found.x, found.v, found.stopped) == (expected.x, expected.v, expected.stopped)


def test_a_stem_that_oscillates_stops_where_it_first_turns() -> None:
    # hardly damped, 8.9 oscillations a second: within a long piece it would turn many times
    load = Load(4000.0, 100.0, 1.0)
    p = pushing_ma(load, 1.0, 0.08, 1.5)
    piece = Piece(2.0, p, 0.0, 1e-3, 1.0)
    found = driven_slide(MODEL, load, 1.0).along(piece, 0.08, 0.1)
    assert found.stopped
    turn_s = math.pi / math.sqrt(4000.0 / VALVE.mass_kg)
    assert 0.4 * turn_s < found.t < turn_s


def test_a_stem_that_nearly_stops_in_a_long_piece_is_caught_at_the_dip_of_its_speed() -> None:
    # the force first brakes, then drives again: without the stop the stem would move at the end
    slide = driven_slide(MODEL, NOMINAL, 1.0)
    low = pushing_ma(NOMINAL, 1.0, 0.08, 0.9)
    piece = Piece(0.2, low + 2.0, 0.0, -2.0, 10.0)
    found = slide.along(piece, 0.08, 0.02)
    assert found.stopped
    assert found.t < 0.03
    end = moved(MODEL, NOMINAL, actuator_of(0.1, 1.0, 0.0, 0.0), 1.0, Moving(0.08, 0.02, low, low), low + 2.0, 0.03)
    assert end.stopped
    assert found.x == pytest.approx(end.x, abs=1e-9)


@settings(max_examples=15, deadline=None)
@given(slow_actuators, light_loads, signs, st.floats(0.01, 0.4), st.floats(0.9, 1.4), st.floats(-3.0, 8.0), brakings)
def test_the_predicted_stop_is_where_the_sampled_commands_stop_the_stem(
    actuator: ActuatorParameters, load: Load, s: float, speed: float, push: float, more_ma: float, braking: float
) -> None:
    x, brake = 0.078, brake_of(actuator, load, s)
    p = pushing_ma(load, s, x, push)
    u = brake.drive.limited(p + s * more_ma)
    brake_ma = pushing_ma(load, s, x + 0.005 * s, braking)
    predicted_m = brake.stop_m(x, s * speed, p, p + s, u, brake_ma)
    state = moved(MODEL, load, actuator, s, Moving(x, s * speed, p, p + s), u, 1e-3)
    samples = 0
    while not state.stopped and samples < 25:
        u = brake.drive.command_ma(state.p, state.w, brake_ma)
        state = moved(MODEL, load, actuator, s, state, u, 1e-3)
        samples += 1
    if state.stopped:
        # behind a converter the last sample at the limit is not whole
        within_m = 2e-4 if actuator.converter_time_constant_s else 1e-7
        assert predicted_m == pytest.approx(state.x, abs=within_m)


@settings(max_examples=60)
@given(actuators, loads, signs, st.floats(0.01, 0.4), st.floats(0.9, 1.4), st.floats(-3.0, 8.0), brakings)
def test_the_derivatives_of_the_predicted_stop_are_its_differences(
    actuator: ActuatorParameters, load: Load, s: float, speed: float, push: float, more_ma: float, braking: float
) -> None:
    x, brake = 0.078, brake_of(actuator, load, s)
    p = pushing_ma(load, s, x, push)
    state = (x, s * speed, p, p + s, brake.drive.limited(p + s * more_ma))
    brake_ma = pushing_ma(load, s, x + 0.005 * s, braking)
    found = brake.stop(*state, brake_ma)
    assert found.x == brake.stop_m(*state, brake_ma)
    steps = (1e-7, 1e-6, 1e-5, 1e-5, 1e-5)
    for derivative, number, step in zip(derivatives(found), range(5), steps, strict=True):
        above, below = list(state), list(state)
        above[number] += step
        below[number] -= step
        slopes = [
            (place(brake, above, brake_ma) - found.x) / step,
            (found.x - place(brake, below, brake_ma)) / step,
        ]
        # a state at the edge of a phase has two slopes
        margin = 2e-3 * abs(derivative) + 1e-9
        assert min(slopes) - margin <= derivative <= max(slopes) + margin


def place(brake: Brake, state: list[float], brake_ma: float) -> float:
    x, v, p, w, u = state
    return brake.stop_m(x, v, p, w, u, brake_ma)


def derivatives(stop: Stop) -> tuple[float, float, float, float, float]:
    return stop.x_x, stop.x_v, stop.x_p, stop.x_w, stop.x_u


@settings(max_examples=60)
@given(
    st.builds(actuator_of, st.sampled_from((0.0, 0.005, 0.05, 0.3)), st.just(0.6), st.just(0.0), st.just(0.0)),
    signs,
    st.floats(0.05, 0.4),
    st.floats(-0.2, 1.2),
)
def test_the_current_for_a_target_leads_the_stop_there_or_is_at_its_bound(
    actuator: ActuatorParameters, s: float, speed: float, part: float
) -> None:
    x, brake = 0.078, brake_of(actuator, NOMINAL, s)
    p = pushing_ma(NOMINAL, s, x, 1.2)
    state = x, s * speed, p, p
    fastest_ma = 20.0 if s > 0.0 else 4.0
    brake_ma = pushing_ma(NOMINAL, s, x + 0.005 * s, -0.4)
    slowest_ma = brake.drive.command_ma(p, p, brake_ma)
    near, far = brake.stop_m(*state, slowest_ma, brake_ma), brake.stop_m(*state, fastest_ma, brake_ma)
    target_m = near + part * (far - near)
    current_ma = brake.current_ma(*state, target_m, brake_ma, fastest_ma)
    if part >= 1.0:
        assert current_ma == fastest_ma
    elif part <= 0.0:
        assert brake.stop_m(*state, current_ma, brake_ma) == pytest.approx(near, abs=2e-6)
    else:
        assert brake.stop_m(*state, current_ma, brake_ma) == pytest.approx(target_m, abs=2e-6)


@pytest.mark.parametrize("lag_s", [0.0, 0.02])
@pytest.mark.parametrize(("low_ma", "s"), [(13.5, 1.0), (4.0, -1.0)])
def test_a_braking_pressure_beyond_the_limits_of_the_loop_is_never_reached(
    lag_s: float, low_ma: float, s: float
) -> None:
    x, high_ma = 0.078, 20.0 if s > 0.0 else 10.5
    drive = drive_of(actuator_of(lag_s, 1.0, 0.0, 0.0), 1e-3, low_ma, high_ma)
    brake = Brake(driven_slide(MODEL, NOMINAL, s), drive)
    p = pushing_ma(NOMINAL, s, x, 1.1)
    beyond_ma = pushing_ma(NOMINAL, s, x, -0.4)
    assert not low_ma <= beyond_ma <= high_ma
    predicted_m = brake.stop_m(x, s * 0.2, p, p, drive.limited(p), beyond_ma)
    state = Moving(x, s * 0.2, p, p)
    u = drive.limited(p)
    actuator = actuator_of(lag_s, 1.0, 0.0, 0.0)
    while not state.stopped:
        state = moved(MODEL, NOMINAL, actuator, s, state, u, 1e-3)
        u = drive.command_ma(state.p, state.w, beyond_ma)
    assert predicted_m == pytest.approx(state.x, abs=1e-7)
