"""The motion with a stop inside, against the plant emulator's closed form; every derivative, against differences."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from plant_emulator import valve as plant
from plant_emulator.presets import plant_settings
from positioner.valve.motion import Load, MotionModel
from positioner.valve.parameters import ValveParameters

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.valve.motion import Transition

VALVE = ValveParameters(id="paper")
MODEL = MotionModel.of(VALVE)
NOMINAL = Load.of(VALVE)
CRITICAL_N_S_PER_M = 2.0 * (VALVE.mass_kg * VALVE.spring_rate_n_per_m) ** 0.5

loads = st.builds(
    Load,
    st.floats(3e4, 1e5),
    st.floats(300.0, 2500.0),
    st.floats(150.0, 1200.0) | st.just(CRITICAL_N_S_PER_M) | st.just(CRITICAL_N_S_PER_M * (1.0 + 1e-7)),
)
directions = st.sampled_from((1.0, -1.0))
places = st.floats(0.01, 0.12)
speeds = st.floats(1e-3, 3.0)
currents = st.floats(4.0, 20.0)
durations = st.sampled_from((1e-4, 1e-3, 1e-2))


@settings(max_examples=40)
@given(loads, directions, st.floats(0.03, 0.1), st.floats(0.0, 8.0), st.floats(0.0, 0.9))
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


@pytest.mark.parametrize("name", ["x", "v", "current", "spring", "viscous"])
@given(loads, directions, places, speeds, currents, durations)
@example(Load(52538.0, 300.0, 534.8055059583598), -1.0, 0.01, 0.001953125, 5.0, 1e-4)  # two poles, nearly one
def test_the_derivatives_are_those_of_the_flow(
    name: str, load: Load, s: float, x: float, speed: float, u: float, duration_s: float
) -> None:
    def end(h: float) -> Transition:
        ways: dict[str, Callable[[], Transition]] = {
            "x": lambda: MODEL.step(x + h, s * speed, u, load, s, duration_s),
            "v": lambda: MODEL.step(x, s * speed + h, u, load, s, duration_s),
            "current": lambda: MODEL.step(x, s * speed, u + h, load, s, duration_s),
            "spring": lambda: MODEL.step(
                x, s * speed, u, replace(load, spring_n_per_m=load.spring_n_per_m + h), s, duration_s
            ),
            "viscous": lambda: MODEL.step(
                x, s * speed, u, replace(load, viscous_n_s_per_m=load.viscous_n_s_per_m + h), s, duration_s
            ),
        }
        return ways[name]()

    step = {"x": 1e-6, "v": 1e-5, "current": 1e-4, "spring": 1.0, "viscous": 1e-2}[name]
    here, ahead, behind = end(0.0), end(step), end(-step)
    assume(here.stopped == ahead.stopped == behind.stopped)
    gain = MODEL.gain_n_per_ma
    expected_x, expected_v = {
        "x": (here.dx_dx, here.dv_dx),
        "v": (here.dx_dv, here.dv_dv),
        "current": (here.dx_dq * gain, here.dv_dq * gain),
        "spring": (here.dx_dk, here.dv_dk),
        "viscous": (here.dx_dc, here.dv_dc),
    }[name]
    # rounding of x to 1e-16 and of v to 1e-14, over the step; and the step itself
    assert (ahead.x - behind.x) / (2.0 * step) == pytest.approx(expected_x, rel=1e-3, abs=1e-15 / step)
    assert (ahead.v - behind.v) / (2.0 * step) == pytest.approx(expected_v, rel=1e-3, abs=3e-14 / step)


@given(directions, places, currents)
def test_a_stem_that_rests_unpushed_stays(s: float, x: float, u: float) -> None:
    assume(s * (MODEL.push_n(u, s, NOMINAL.friction_n) - NOMINAL.spring_n_per_m * x) <= 0.0)
    for still in (0.0, -0.0):
        end = MODEL.step(x, still, u, NOMINAL, s, 1e-3)
        assert end.stopped
        assert end.x == pytest.approx(x, abs=1e-15)


@given(loads, directions, places, st.floats(0.01, 10.0))
def test_a_stem_that_is_pushed_leaves_its_rest_in_either_direction(load: Load, s: float, x: float, more: float) -> None:
    u = MODEL.current_ma(load.spring_n_per_m * x + s * load.friction_n) + s * more
    for still in (0.0, -0.0):
        assert s * MODEL.step(x, still, u, load, s, 1e-3).v > 0.0


def test_current_and_push_are_inverse() -> None:
    model = MotionModel.of(ValveParameters(id="preloaded", bench_set_n=700.0))
    assert model.push_n(model.current_ma(1234.5), 1.0, 0.0) == pytest.approx(1234.5)
    assert model.push_n(model.current_ma(1000.0), -1.0, 200.0) == pytest.approx(1200.0)
