"""The motion model: its closed form against an independent integration."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import simpson, solve_ivp

from plant_emulator import valve as plant
from plant_emulator.presets import plant_settings
from positioner.valve.motion import Load, MotionModel, Transition
from positioner.valve.parameters import ValveParameters

NOMINAL = ValveParameters(id="nominal")
CRITICAL_N_S_PER_M = 2.0 * math.sqrt(NOMINAL.spring_rate_n_per_m * NOMINAL.mass_kg)
VALVES = {
    "overdamped": NOMINAL,
    "underdamped": replace(NOMINAL, viscous_friction_n_s_per_m=100.0),
    "critically damped": replace(NOMINAL, viscous_friction_n_s_per_m=CRITICAL_N_S_PER_M),
    "very overdamped, preloaded": replace(NOMINAL, viscous_friction_n_s_per_m=9000.0, bench_set_n=300.0),
    "frictionless": replace(NOMINAL, static_friction_n=0.0, coulomb_friction_n=0.0),
}
MODEL = MotionModel.of(NOMINAL)
loads = st.builds(
    Load,
    st.floats(3e4, 1e5),
    st.floats(300.0, 2500.0),
    st.floats(150.0, 1200.0) | st.just(CRITICAL_N_S_PER_M) | st.just(CRITICAL_N_S_PER_M * (1.0 + 1e-7)),
)
any_valve = st.sampled_from(list(VALVES.values()))
positions_m = st.floats(0.0, 0.14)
speeds_m_per_s = st.floats(1e-3, 2.0)
currents_ma = st.floats(4.0, 20.0)
signs = st.sampled_from([-1.0, 1.0])
durations_s = st.sampled_from([1e-4, 1e-3, 5e-3, 3e-2])


def slide(valve: ValveParameters, x: float, v: float, u: float, direction: float, duration_s: float) -> Transition:
    """Return the motion of a stem of `valve` under its nominal load."""
    return MotionModel.of(valve).step(x, v, u, Load.of(valve), direction, duration_s)


def acceleration(valve: ValveParameters, x: float, v: float, u: float, direction: float) -> float:
    """Return eq. 11 without its Stribeck term, written from Table 3 once more."""
    pressure_n = valve.diaphragm_area_m2 * valve.pressure_gain_pa_per_ma * u
    spring_n = valve.spring_rate_n_per_m * x + valve.bench_set_n
    friction_n = direction * valve.coulomb_friction_n + valve.viscous_friction_n_s_per_m * v
    return (pressure_n - spring_n - friction_n) / valve.mass_kg


def integrated(
    valve: ValveParameters, x: float, v: float, u: float, direction: float, duration_s: float
) -> tuple[float, float, float | None]:
    """Return position, speed and, where the stem stops, the instant, by a Runge-Kutta integration with that event."""

    def stop(_t: float, state: tuple[float, float]) -> float:
        return state[1] * direction

    stop.terminal = True  # type: ignore[attr-defined]
    stop.direction = -1.0  # type: ignore[attr-defined]
    run = solve_ivp(
        lambda _t, state: (state[1], acceleration(valve, state[0], state[1], u, direction)),
        (0.0, duration_s),
        (x, v),
        method="DOP853",
        rtol=1e-11,
        atol=1e-13,
        events=stop,
    )
    stopped_s = float(run.t_events[0][0]) if run.t_events[0].size else None
    return float(run.y[0, -1]), float(run.y[1, -1]), stopped_s


@settings(max_examples=60)
@given(any_valve, positions_m, speeds_m_per_s, currents_ma, signs, durations_s)
def test_a_slide_is_what_an_independent_integration_finds(
    valve: ValveParameters, x: float, speed: float, u: float, direction: float, duration_s: float
) -> None:
    motion = slide(valve, x, direction * speed, u, direction, duration_s)
    end_x, end_v, stopped_s = integrated(valve, x, direction * speed, u, direction, duration_s)
    assume(stopped_s is None or abs(stopped_s - duration_s) > 1e-9)
    assume(stopped_s is not None or abs(end_v) > 1e-7)
    assert motion.stopped == (stopped_s is not None)
    assert motion.x == pytest.approx(end_x, abs=1e-10)
    assert motion.v == (0.0 if motion.stopped else pytest.approx(end_v, abs=1e-8))


@pytest.mark.parametrize("name", VALVES)
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_stem_that_is_pushed_from_rest_moves_as_integrated(name: str, direction: float) -> None:
    valve = VALVES[name]
    x = 0.08
    u = valve.balance_current_ma(x) + direction * (valve.static_friction_n + 50.0) / valve.force_gain_n_per_ma
    motion = slide(valve, x, 0.0, u, direction, 0.004)
    end_x, end_v = solve_ivp(
        lambda _t, state: (state[1], acceleration(valve, state[0], state[1], u, direction)),
        (0.0, 0.004),
        (x, 0.0),
        method="DOP853",
        rtol=1e-11,
        atol=1e-13,
    ).y[:, -1]
    assert not motion.stopped
    assert motion.x == pytest.approx(end_x, abs=1e-11)
    assert motion.v == pytest.approx(end_v, abs=1e-9)
    assert direction * motion.v > 1e-3


@pytest.mark.parametrize("name", ["overdamped", "underdamped", "critically damped", "very overdamped, preloaded"])
def test_a_braked_stem_stops_inside_the_sample_and_stays(name: str) -> None:
    valve = VALVES[name]
    _, _, stopped_s = integrated(valve, 0.08, 0.3, 4.0, 1.0, 0.05)
    assert stopped_s is not None
    inside = slide(valve, 0.08, 0.3, 4.0, 1.0, stopped_s * 1.01)
    later = slide(valve, 0.08, 0.3, 4.0, 1.0, stopped_s * 100.0)
    assert inside.stopped
    assert inside == later
    assert not slide(valve, 0.08, 0.3, 4.0, 1.0, stopped_s * 0.99).stopped


@pytest.mark.parametrize("name", VALVES)
@pytest.mark.parametrize("v", [0.0, -0.0])
def test_a_stem_at_rest_that_is_not_pushed_forward_stays_where_it_is(name: str, v: float) -> None:
    valve = VALVES[name]
    held = valve.balance_current_ma(0.08)
    motion = slide(valve, 0.08, v, held - 0.5, 1.0, 0.01)
    assert (motion.v, motion.stopped) == (0.0, True)
    assert (motion.dx_dx, motion.dx_dv, motion.dv_dx, motion.dv_dv) == (1.0, 0.0, 0.0, 0.0)
    assert motion.x == pytest.approx(0.08, abs=1e-15)
    assert slide(valve, 0.08, v, held + 0.5, -1.0, 0.01).x == pytest.approx(0.08, abs=1e-15)


def test_the_sign_of_a_zero_speed_means_nothing() -> None:
    for valve in VALVES.values():
        assert slide(valve, 0.08, -0.0, 20.0, 1.0, 0.001) == slide(valve, 0.08, 0.0, 20.0, 1.0, 0.001)
        assert slide(valve, 0.08, -0.0, 4.0, -1.0, 0.001) == slide(valve, 0.08, 0.0, 4.0, -1.0, 0.001)


def test_a_stem_that_already_moves_against_the_direction_has_stopped() -> None:
    for direction in (1.0, -1.0):
        motion = slide(NOMINAL, 0.08, -direction * 0.2, 12.0, direction, 0.001)
        assert motion.x == pytest.approx(0.08, abs=1e-15)
        assert (motion.v, motion.stopped) == (0.0, True)


def test_a_critically_damped_stem_on_its_slow_line_never_stops() -> None:
    # where h v + (K/m) z = 0 the solution is a pure exponential: its speed has no zero
    valve = VALVES["critically damped"]
    half = valve.viscous_friction_n_s_per_m / (2.0 * valve.mass_kg)
    u = 12.0
    rest = (valve.net_force_n(0.0, u) - valve.coulomb_friction_n) / valve.spring_rate_n_per_m
    z = -0.01
    v = -z * valve.spring_rate_n_per_m / valve.mass_kg / half
    motion = slide(valve, rest + z, v, u, 1.0, 0.01)
    assert not motion.stopped
    assert motion.v == pytest.approx(v * math.exp(-half * 0.01), rel=1e-6)


def test_a_very_long_sample_of_a_stiffly_damped_valve_ends_at_the_balance_and_does_not_overflow() -> None:
    valve = replace(NOMINAL, mass_kg=0.01, viscous_friction_n_s_per_m=1e4)
    motion = slide(valve, 0.05, 0.0, 16.0, 1.0, 10.0)
    rest = (valve.net_force_n(0.0, 16.0) - valve.coulomb_friction_n) / valve.spring_rate_n_per_m
    assert motion.x == pytest.approx(rest, abs=1e-12)


@settings(max_examples=100)
@given(any_valve, positions_m, speeds_m_per_s, currents_ma, signs, durations_s)
def test_the_derivatives_are_those_of_finite_differences(
    valve: ValveParameters, x: float, speed: float, u: float, direction: float, duration_s: float
) -> None:
    v = direction * speed
    step_x, step_v = 1e-6, 1e-5

    def at(dx: float, dv: float) -> Transition:
        return slide(valve, x + dx, v + dv, u, direction, duration_s)

    motion = at(0.0, 0.0)
    around = (at(step_x, 0.0), at(-step_x, 0.0), at(0.0, step_v), at(0.0, -step_v))
    assume(all(near.stopped == motion.stopped for near in around))
    for name in ("x", "v"):
        ends = [getattr(near, name) for near in around]
        by_x, by_v = (ends[0] - ends[1]) / (2 * step_x), (ends[2] - ends[3]) / (2 * step_v)
        # around a stop the end is a little curved
        assert getattr(motion, f"d{name}_dx") == pytest.approx(by_x, rel=2e-3, abs=2e-4 if name == "x" else 2e-2)
        assert getattr(motion, f"d{name}_dv") == pytest.approx(by_v, rel=2e-3, abs=2e-5 if name == "x" else 2e-3)


@settings(max_examples=60)
@given(any_valve, positions_m, speeds_m_per_s, currents_ma, signs)
def test_two_short_slides_are_one_long_slide(
    valve: ValveParameters, x: float, speed: float, u: float, direction: float
) -> None:
    whole = slide(valve, x, direction * speed, u, direction, 0.002)
    first = slide(valve, x, direction * speed, u, direction, 0.0007)
    second = slide(valve, first.x, first.v, u, direction, 0.0013)
    assume(not whole.stopped)
    assert second.x == pytest.approx(whole.x, abs=1e-13)
    assert second.v == pytest.approx(whole.v, abs=1e-11)


@pytest.mark.parametrize("name", VALVES)
def test_the_work_of_the_pressure_goes_into_spring_speed_and_friction(name: str) -> None:
    valve, x, v, u, duration_s = VALVES[name], 0.06, 0.4, 18.0, 0.008
    times = np.linspace(0.0, duration_s, 2001)
    path = [slide(valve, x, v, u, 1.0, float(t)) for t in times]
    assert not path[-1].stopped
    end_x, end_v = path[-1].x, path[-1].v

    def stored(position: float, speed: float) -> float:
        spring = 0.5 * valve.spring_rate_n_per_m * position**2 + valve.bench_set_n * position
        return spring + 0.5 * valve.mass_kg * speed**2

    damped = valve.viscous_friction_n_s_per_m * float(simpson([motion.v**2 for motion in path], x=times))
    rubbed = valve.coulomb_friction_n * (end_x - x)
    given_j = valve.force_gain_n_per_ma * u * (end_x - x)
    assert given_j == pytest.approx(stored(end_x, end_v) - stored(x, v) + damped + rubbed, rel=1e-9)


@settings(max_examples=40)
@given(loads, signs, st.floats(0.03, 0.1), st.floats(0.0, 8.0), st.floats(0.0, 0.9))
def test_the_stop_is_where_the_plant_stops(load: Load, s: float, x: float, push_ma: float, part: float) -> None:
    # F_s = F_c and a band of 0.1 µm/s: what is left of the plant's friction is the filter's
    overrides = {
        "valve": {
            "initial_position_m": x,
            "spring_rate_n_per_m": load.spring_n_per_m,
            "static_friction_n": load.friction_n,
            "coulomb_friction_n": load.friction_n,
            "viscous_friction_n_s_per_m": load.viscous_n_s_per_m,
            "stick_velocity_m_per_s": 1e-7,
            "travel_min_m": -0.9,
            "travel_max_m": 0.9,
        }
    }
    valve = plant_settings("paper", overrides)
    start = plant.initial_state(valve, 1)
    middle_ma = MODEL.current_ma(load.spring_n_per_m * x)
    push = middle_ma + s * (load.friction_n / MODEL.gain_n_per_ma + 0.2 + push_ma)
    pushed = plant.step(valve, start, push, 1e-3)
    brake = middle_ma - s * part * load.friction_n / MODEL.gain_n_per_ma
    stopped = plant.step(valve, pushed, brake, 0.5)

    end = MODEL.step(x, 0.0, push, load, s, 1e-3)
    assert end.x == pytest.approx(pushed.stem.position_m, abs=1e-9)
    assert end.v == pytest.approx(pushed.stem.velocity_m_per_s, abs=1e-6)
    rest = MODEL.step(end.x, end.v, brake, load, s, 0.5)
    assert rest.stopped
    assert rest.v == 0.0
    # where braking beats friction at the stop, the plant turns round and moves on
    assume(stopped.stem.reversals == 0)
    assert rest.x == pytest.approx(stopped.stem.position_m, abs=2e-9)


@given(signs, positions_m, currents_ma)
def test_a_stem_that_rests_unpushed_stays(s: float, x: float, u: float) -> None:
    assume(s * (MODEL.push_n(u, s, Load.of(NOMINAL).friction_n) - Load.of(NOMINAL).spring_n_per_m * x) <= 0.0)
    for still in (0.0, -0.0):
        end = MODEL.step(x, still, u, Load.of(NOMINAL), s, 1e-3)
        assert end.stopped
        assert end.x == pytest.approx(x, abs=1e-15)


@given(loads, signs, positions_m, st.floats(0.01, 10.0))
def test_a_stem_that_is_pushed_leaves_its_rest_in_either_direction(load: Load, s: float, x: float, more: float) -> None:
    u = MODEL.current_ma(load.spring_n_per_m * x + s * load.friction_n) + s * more
    for still in (0.0, -0.0):
        assert s * MODEL.step(x, still, u, load, s, 1e-3).v > 0.0


def test_current_and_push_are_inverse() -> None:
    model = MotionModel.of(ValveParameters(id="preloaded", bench_set_n=700.0))
    assert model.push_n(model.current_ma(1234.5), 1.0, 0.0) == pytest.approx(1234.5)
    assert model.push_n(model.current_ma(1000.0), -1.0, 200.0) == pytest.approx(1200.0)
