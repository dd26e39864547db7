"""The valve against closed forms and published figures: jumps, decay, signature, energy, independence of the step."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from plant_emulator import valve
from plant_emulator.presets import plant_settings

if TYPE_CHECKING:
    from collections.abc import Callable

    from plant_emulator.parameters import PlantSettings
    from plant_emulator.valve import PlantState

PAPER = plant_settings("paper")
GAIN_N_PER_MA = PAPER.valve.diaphragm_area_m2 * PAPER.valve.pressure_gain_pa_per_ma
RATE = PAPER.valve.spring_rate_n_per_m
STATIC, COULOMB = PAPER.valve.static_friction_n, PAPER.valve.coulomb_friction_n


def current_for(settings: PlantSettings, position_m: float, pull_n: float) -> float:
    """Return the current in mA that leaves `pull_n` for the friction at `position_m`."""
    v = settings.valve
    gain = v.diaphragm_area_m2 * v.pressure_gain_pa_per_ma
    return (v.bench_set_n + v.spring_rate_n_per_m * position_m + pull_n) / gain


def counters(state: PlantState) -> tuple[int, int, int]:
    return state.stem.slips, state.stem.stops, state.stem.reversals


def first_time(reached: Callable[[PlantState], bool], current_ma: float, latest_s: float) -> float:
    """Return the time in s at which the paper's valve under `current_ma`, from rest, first satisfies `reached`."""
    start, low, high = valve.initial_state(PAPER, 0), 0.0, latest_s
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if reached(valve.step(PAPER, start, current_ma, middle)) else (middle, high)
    return high


def test_a_held_force_just_above_static_friction_gives_the_jump_of_an_independent_integration() -> None:
    # Radau, rtol 1e-10, event at DV, clock started where the stem leaves the zero-speed band
    current = current_for(PAPER, 0.01, 1.001 * STATIC)
    end = valve.step(PAPER, valve.initial_state(PAPER, 0), current, 0.2)
    jump_m = end.stem.position_m - 0.01
    assert jump_m == pytest.approx(5.4453e-3, rel=1e-4)
    assert counters(end) == (1, 1, 0)

    leaves_s = first_time(lambda s: s.stem.velocity_m_per_s >= PAPER.valve.stick_velocity_m_per_s, current, 1e-3)
    for part, expected_s in ((0.1, 2.78e-3), (0.86, 20.63e-3), (0.99, 42.7e-3)):
        passed_s = first_time(lambda s, goal=0.01 + part * jump_m: s.stem.position_m >= goal, current, 0.06)  # type: ignore[misc]
        assert passed_s - leaves_s == pytest.approx(expected_s, rel=3e-3)
    stopped_s = first_time(lambda s: s.stem.stops == 1, current, 0.1)
    assert stopped_s - leaves_s == pytest.approx(62.70e-3, rel=5e-4)


def test_the_time_inside_the_zero_speed_band_is_that_of_an_undamped_mass_on_its_spring() -> None:
    # eq. 3 in the band: m·ẍ = 0.001·F_s - K·x from rest, v = (a/ω)·sin(ωt)
    current = current_for(PAPER, 0.01, 1.001 * STATIC)
    omega = math.sqrt(RATE / PAPER.valve.mass_kg)
    expected_s = math.asin(PAPER.valve.stick_velocity_m_per_s * omega * PAPER.valve.mass_kg / (0.001 * STATIC)) / omega
    leaves_s = first_time(lambda s: s.stem.velocity_m_per_s >= PAPER.valve.stick_velocity_m_per_s, current, 1e-3)
    assert leaves_s == pytest.approx(expected_s, rel=1e-4)


def test_the_slip_reaches_the_published_peak_speed() -> None:
    state, peak = valve.initial_state(PAPER, 0), 0.0
    for _ in range(2000):
        state = valve.step(PAPER, state, current_for(PAPER, 0.01, 1.001 * STATIC), 1e-5)
        peak = max(peak, state.stem.velocity_m_per_s)
    assert peak == pytest.approx(0.3589, abs=1e-4)


def test_a_slow_ramp_gives_equal_jumps() -> None:
    state = valve.initial_state(PAPER, 0)
    current = state.actuator.line.current_ma
    landings: list[float] = []
    while len(landings) < 5:
        before = state
        state = valve.step(PAPER, state, current, 0.01)
        current += 0.0003  # 0.03 mA/s: slow against the jump, quicker than Karnopp's band creeps
        if state.stem.stops > before.stem.stops:
            landings.append(state.stem.position_m)
    jumps = np.diff(landings)
    assert jumps == pytest.approx((STATIC - COULOMB) / RATE, rel=0.01)
    assert np.ptp(jumps) < 0.002 * jumps.mean()


def test_a_pull_below_static_friction_never_moves_the_stem_by_a_bit() -> None:
    state = valve.initial_state(PAPER, 0)
    for index in range(2000):
        state = valve.step(PAPER, state, current_for(PAPER, 0.01, (-1) ** index * 0.9999 * STATIC), 3600.0)
    assert state.stem.position_m == 0.01
    assert (state.stem.velocity_m_per_s, state.stem.travel_m, state.stem.slips) == (0.0, 0.0, 0)
    assert abs(valve.friction_n(PAPER, state)) == pytest.approx(0.9999 * STATIC)


def test_free_decay_with_coulomb_friction_alone_loses_the_same_in_every_half_cycle() -> None:
    settings = plant_settings(
        "paper",
        {
            "valve": {
                "static_friction_n": 100.0,
                "coulomb_friction_n": 100.0,
                "viscous_friction_n_s_per_m": 0.0,
                "stick_velocity_m_per_s": 1e-7,
                "initial_position_m": 0.07,
            }
        },
    )
    half_cycle_s = math.pi / math.sqrt(RATE / settings.valve.mass_kg)
    state, extremes = valve.initial_state(settings, 0), []
    for _ in range(4):
        state = valve.step(settings, state, current_for(settings, 0.05, 0.0), half_cycle_s)
        extremes.append(state.stem.position_m - 0.05)
    loss_m = 2.0 * 100.0 / RATE
    assert extremes == pytest.approx([(-1) ** n * (0.02 - n * loss_m) for n in range(1, 5)], abs=1e-9)


def test_a_triangle_shows_the_deadband_and_the_slip_jump_of_the_signature() -> None:
    state = valve.initial_state(PAPER, 0)
    up = np.arange(8.0, 20.0, 0.002)
    currents = np.concatenate([up, up[::-1]])
    rows = []
    for current in currents.tolist():
        state = valve.step(PAPER, state, current, 0.002)  # 1 mA/s, where this valve slides
        rows.append((current, state.stem.position_m, state.stem.slips))
    u, x, slips = np.array(rows).T
    top = len(up)
    back = int(np.flatnonzero(slips > slips[top])[0])
    span_n = GAIN_N_PER_MA * 16.0
    deadband = (u[top] - u[back]) * GAIN_N_PER_MA / span_n
    assert deadband == pytest.approx((STATIC + COULOMB) / span_n, rel=0.005)

    sliding = slice(back + 200, len(u))
    slope, offset = np.polyfit(u[sliding], x[sliding], 1)
    assert slope == pytest.approx(GAIN_N_PER_MA / RATE, rel=0.005)
    assert x[back - 1] - (offset + slope * u[back]) == pytest.approx((STATIC - COULOMB) / RATE, rel=0.03)


@pytest.mark.parametrize("lag_s", [0.0, 0.01])
def test_the_work_of_the_pressure_is_the_energy_of_spring_motion_and_friction(lag_s: float) -> None:
    lags = {"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s}
    settings = plant_settings("paper", {"actuator": lags, "valve": {"initial_position_m": 0.06}})
    state = valve.initial_state(settings, 0)
    area = settings.valve.diaphragm_area_m2
    work = dissipated = 0.0
    for index in range(16000):
        before = state
        pull = 1.2 * STATIC if index < 8000 else -1.3 * STATIC
        state = valve.step(settings, state, current_for(settings, 0.062, pull), 5e-6)
        moved = state.stem.position_m - before.stem.position_m
        end_pa = state.actuator.pressure_pa
        push = end_pa if lag_s == 0.0 else 0.5 * (before.actuator.pressure_pa + end_pa)
        work += area * push * moved
        dissipated += 0.5 * (valve.friction_n(settings, before) + valve.friction_n(settings, state)) * moved
    spring = 0.5 * RATE * (state.stem.position_m**2 - 0.06**2)
    kinetic = 0.5 * settings.valve.mass_kg * state.stem.velocity_m_per_s**2
    assert 0.01 < state.stem.position_m < 0.055  # it went there and back, and met no travel stop
    assert dissipated > 10.0
    assert work - spring - kinetic - dissipated == pytest.approx(0.0, abs=2e-4 * dissipated)


@pytest.mark.parametrize("preset", ["paper", "frictionless", "stochastic", "graphite"])
@pytest.mark.parametrize("lags", [(0.0, 0.0), (0.02, 0.005)])
def test_the_result_does_not_depend_on_how_time_is_divided_into_steps(preset: str, lags: tuple[float, float]) -> None:
    settings = plant_settings(
        preset, {"actuator": {"fill_time_constant_s": lags[0], "vent_time_constant_s": lags[1], "dead_time_s": 0.0023}}
    )
    base = valve.initial_state(settings, 3).actuator.line.current_ma
    commands = [(base + delta, 0.03) for delta in (5.4, 5.4, 1.0, 12.0, -6.0, 7.0)]
    ends = []
    for pieces in (1, 30, 301):
        state = valve.initial_state(settings, 3)
        for current, duration in commands:
            for _ in range(pieces):
                state = valve.step(settings, state, current, duration / pieces)
        ends.append(state)
    assert ends[0].stem.travel_m > 0.001
    for end in ends[1:]:
        assert end.stem.position_m == pytest.approx(ends[0].stem.position_m, abs=1e-9)
        assert end.stem.velocity_m_per_s == pytest.approx(ends[0].stem.velocity_m_per_s, abs=1e-6)
        assert counters(end) == counters(ends[0])
        assert end.stem.travel_m == pytest.approx(ends[0].stem.travel_m, abs=1e-9)


@pytest.mark.parametrize(("current_ma", "stop_m"), [(25.0, 0.1397), (0.0, 0.0)])
def test_a_travel_stop_ends_the_motion_without_a_bounce_and_holds_any_force(current_ma: float, stop_m: float) -> None:
    state = valve.step(PAPER, valve.initial_state(PAPER, 0), current_for(PAPER, 0.06, 0.0), 1.0)
    gone = valve.step(PAPER, state, 40.0 if current_ma else -40.0, 1.0)
    assert gone.stem.position_m == stop_m
    assert gone.stem.is_at_rest
    assert gone.stem.velocity_m_per_s == 0.0
    assert abs(valve.friction_n(PAPER, gone)) == pytest.approx(STATIC)
    back = valve.step(PAPER, gone, current_for(PAPER, stop_m, math.copysign(1.01 * STATIC, 0.06 - stop_m)), 1.0)
    assert abs(back.stem.position_m - stop_m) > 0.004
    assert back.stem.reversals == gone.stem.reversals + 1


def test_creep_holds_the_band_edge_until_static_friction_suffices() -> None:
    # graphite: sliding at DV takes F_c + (F_s - F_c)·e^(-(DV/V_s)²) + F_v·DV = 952 N, more than F_s = 942 N
    settings = plant_settings("graphite", "actuator.fill_time_constant_s = 0.0")
    v = settings.valve
    current = current_for(settings, 0.015, v.static_friction_n + 5.0)
    way_m = 5.0 / v.spring_rate_n_per_m
    creeping = valve.step(settings, valve.initial_state(settings, 0), current, 0.5 * way_m / v.stick_velocity_m_per_s)
    assert creeping.stem.velocity_m_per_s == v.stick_velocity_m_per_s
    assert valve.friction_n(settings, creeping) == pytest.approx(v.static_friction_n + 2.5, abs=0.1)
    rested = valve.step(settings, creeping, current, 1.0)
    assert rested.stem.position_m - 0.015 == pytest.approx(way_m, rel=1e-6)
    assert rested.stem.is_at_rest
    pushed = valve.step(settings, creeping, current + 0.05, 0.01)
    assert pushed.stem.velocity_m_per_s > 2.0 * v.stick_velocity_m_per_s


def test_a_frictionless_valve_settles_on_every_current_and_never_sticks() -> None:
    settings = plant_settings("frictionless")
    state = valve.initial_state(settings, 0)
    for current in (4.0, 4.001, 12.0, 3.0):
        state = valve.step(settings, state, current, 1.0)
        assert state.stem.position_m == pytest.approx(GAIN_N_PER_MA * current / RATE, abs=1e-10)
    assert (state.stem.slips, state.stem.stops) == (0, 0)
    assert state.stem.reversals == 1


def test_a_frictionless_underdamped_valve_swings_through_its_reversals() -> None:
    settings = plant_settings("frictionless", "valve.viscous_friction_n_s_per_m = 50.0")
    start, current = valve.initial_state(settings, 0), current_for(settings, 0.06, 0.0)
    mass, decay = settings.valve.mass_kg, 50.0 / (2.0 * settings.valve.mass_kg)
    omega = math.sqrt(RATE / mass - decay * decay)
    for cycles in (1, 2, 5):
        time_s = cycles * math.pi / omega  # extremes of e^(-σt)·(cos ωt + σ/ω·sin ωt)
        end = valve.step(settings, start, current, time_s)
        assert end.stem.position_m == pytest.approx(0.06 - 0.05 * (-1) ** cycles * math.exp(-decay * time_s), abs=1e-11)
        assert valve.step(settings, start, current, time_s + 1e-4).stem.reversals == cycles


def test_the_spring_preload_shifts_the_balance() -> None:
    settings = plant_settings("frictionless", "valve.bench_set_n = 500.0")
    end = valve.step(settings, valve.initial_state(settings, 0), 10.0, 2.0)
    assert end.stem.position_m == pytest.approx((GAIN_N_PER_MA * 10.0 - 500.0) / RATE, abs=1e-10)
    assert valve.initial_state(settings, 0).actuator.pressure_pa * settings.valve.diaphragm_area_m2 == pytest.approx(
        500.0 + 0.01 * RATE
    )


def test_a_reversed_force_while_sliding_reverses_the_stem_without_a_stick() -> None:
    moving = valve.step(PAPER, valve.initial_state(PAPER, 0), current_for(PAPER, 0.02, 2.0 * STATIC), 0.01)
    turned = valve.step(PAPER, moving, current_for(PAPER, 0.0, -2.0 * STATIC), 0.005)
    assert turned.stem.velocity_m_per_s < -0.1
    assert counters(turned) == (1, 0, 1)
    assert turned.stem.travel_m > abs(turned.stem.position_m - 0.01) + 1e-4


def test_a_step_of_no_time_changes_nothing() -> None:
    moving = valve.step(PAPER, valve.initial_state(PAPER, 0), 9.0, 0.01)
    assert valve.step(PAPER, moving, 9.0, 0.0) == moving


@pytest.mark.parametrize("distance_m", [1e-9, 5e-8, 1e-6, 1e-4])
def test_a_travel_stop_is_met_in_every_kind_of_motion(distance_m: float) -> None:
    # in the zero-speed band, on Stribeck's curve, and beyond it
    start_m = PAPER.valve.travel_max_m - distance_m
    settings = plant_settings("paper", {"valve": {"initial_position_m": start_m}})
    end = valve.step(settings, valve.initial_state(settings, 0), current_for(settings, start_m, 1.001 * STATIC), 0.1)
    assert end.stem.position_m == PAPER.valve.travel_max_m
    assert end.stem.is_at_rest
    assert end.stem.travel_m == pytest.approx(distance_m, rel=1e-6)
    assert (end.stem.slips, end.stem.stops) == (1, 1)


def test_a_travel_stop_ends_creep() -> None:
    settings = plant_settings("graphite", {"valve": {"initial_position_m": 0.03 - 1e-6}})
    start = valve.initial_state(settings, 0)
    pull_n = settings.valve.static_friction_n + 5.0  # lag is 0.1 s: it creeps for long before this is reached
    end = valve.step(settings, start, current_for(settings, 0.03, pull_n), 2.0)
    assert end.stem.position_m == 0.03
    assert end.stem.is_at_rest
