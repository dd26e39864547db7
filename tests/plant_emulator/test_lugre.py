"""LuGre friction against an independent integrator, closed forms, and the behaviour that its authors published."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from elastic_contact import MOVES, dragged, played, quiet
from scipy.integrate import solve_ivp

from plant_emulator import valve
from plant_emulator.constants import constants_of
from plant_emulator.contact import Contact
from plant_emulator.force import PushingForce
from plant_emulator.friction import initial_packing
from plant_emulator.lugre import LuGreStem
from plant_emulator.presets import plant_settings
from plant_emulator.stem import Stem
from plant_emulator.valve import friction_n, initial_state
from positioner.errors import ConfigurationError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from plant_emulator.parameters import PlantSettings

PLANT = quiet("lugre", 0.0)
F_S, F_C, V_S, F_V = 1707.7, 1423.0, 0.000254, 612.9
S_0, S_1 = 1.423e8, 13917.0


def _integrated(lag_s: float) -> NDArray[np.float64]:
    """Return the positions after each ms of `MOVES` by SciPy's Radau, from equations written here anew."""
    area, gain, spring, mass = 0.06452, 5171.06775, 52538.0, 1.361
    y, pressure_pa, found = [0.01, 0.0, 0.0], spring * 0.01 / area, []
    for current_ma, seconds in MOVES:
        target_pa, begun_pa = gain * current_ma, pressure_pa

        def slopes(t: float, y: list[float], target_pa: float = target_pa, begun_pa: float = begun_pa) -> list[float]:
            x, v, z = y
            pressure_pa = target_pa + (begun_pa - target_pa) * (math.exp(-t / lag_s) if lag_s else 0.0)
            g = F_C + (F_S - F_C) * math.exp(-((v / V_S) ** 2))
            bending = v - S_0 * abs(v) / g * z
            force = area * pressure_pa - spring * x - S_0 * z - S_1 * bending - F_V * v
            return [v, force / mass, bending]

        ends = np.arange(1, round(seconds / 1e-3) + 1) * 1e-3
        solved = solve_ivp(
            slopes, (0.0, ends[-1]), y, "Radau", ends, rtol=1e-7, atol=[1e-10, 1e-8, 1e-13], max_step=5e-3
        )
        found.append(solved.y[0])
        y = solved.y[:, -1]
        pressure_pa = target_pa + (begun_pa - target_pa) * (math.exp(-seconds / lag_s) if lag_s else 0.0)
    return np.concatenate(found)


@pytest.mark.parametrize("lag_s", [0.0, 0.02])
def test_moves_are_those_of_an_independent_integrator(lag_s: float) -> None:
    ours, theirs = played(quiet("lugre", lag_s), 1e-3), _integrated(lag_s)
    assert 0.02 < np.ptp(theirs) < 0.06
    assert np.abs(ours - theirs).max() < 5e-6


@pytest.mark.parametrize("period_s", [1e-4, 5e-3])
def test_the_result_hardly_depends_on_how_the_time_is_divided(period_s: float) -> None:
    settings = quiet("lugre", 0.01)
    one, other = played(settings, 1e-3), played(settings, period_s)
    if period_s < 1e-3:
        other = other[9::10]
    else:
        one = one[4::5]
    assert np.abs(one - other).max() < 2e-6


def test_slow_presliding_follows_dahls_curve() -> None:
    step_s, speed = 1e-3, 1e-6  # far below V_s, so that g is F_s
    forces = dragged(PLANT, np.full(20_000, speed), step_s)
    x = (np.arange(forces.size) + 0.5) * speed * step_s
    dahl = F_S * -np.expm1(-S_0 * x / F_S)
    assert forces == pytest.approx(dahl + (F_V + S_1) * speed, abs=0.05)


def test_presliding_to_and_fro_is_a_closed_loop_that_loses_energy() -> None:
    step_s, speed, count = 1e-3, 2e-6, 4000  # by 8 µm
    half = np.full(count, speed)
    forces = dragged(PLANT, np.concatenate([half[: count // 2], *[-half, half] * 12]), step_s)
    one, other = forces[-4 * count : -2 * count], forces[-2 * count :]
    assert np.abs(one - other).max() < 0.5
    lost_j = float(np.sum(other[count:]) - np.sum(other[:count])) * speed * step_s
    # between Dahl's branches, from -F_r to F_r and back: the closed form of the area
    span_m, bend_m = speed * step_s * count, F_S / S_0
    end_n = F_S * math.tanh(0.5 * span_m / bend_m)
    area_j = 2.0 * (F_S * span_m - (F_S + end_n) * bend_m * -math.expm1(-span_m / bend_m))
    assert lost_j == pytest.approx(area_j, rel=0.01)


def test_steady_sliding_is_on_stribecks_curve() -> None:
    for speed in (1e-5, 2e-4, 5e-4, 1e-2, 0.5):
        forces = dragged(PLANT, np.full(2000, speed), 1e-7 / speed)
        curve = F_C + (F_S - F_C) * math.exp(-((speed / V_S) ** 2)) + F_V * speed
        assert forces[-1] == pytest.approx(curve, rel=2e-3)


def test_friction_lags_behind_the_speed() -> None:
    """At the same speed it is smaller while the stem slows down: Canudas de Wit et al., section IV B."""
    step_s, hertz = 1e-4, 10.0
    time = np.arange(round(0.4 / step_s)) * step_s
    speeds = V_S * (1.5 - np.cos(math.tau * hertz * time))
    forces = dragged(PLANT, speeds, step_s)[-round(1.0 / hertz / step_s) :]
    half = forces.size // 2
    faster, slower = forces[:half], forces[half:][::-1]
    middle = slice(half // 4, 3 * half // 4)
    assert np.all(faster[middle] - slower[middle] > 5.0)
    assert np.all(faster[middle] - slower[middle] < F_S - F_C)


def _breakaway_n(rate_n_per_s: float) -> float:
    """Return the greatest force of the bristles, in N, under a push that grows at this rate from 1,000 N on."""
    settings = quiet("lugre", 0.0, valve={"initial_position_m": 0.05})
    constants, packing = constants_of(settings), initial_packing(settings, 1)
    moving = LuGreStem(constants, Stem(position_m=0.05), packing, 0.0, None, Contact((1000.0,), (0,)))
    most_n, push_n = 0.0, 52538.0 * 0.05 + 1000.0
    while moving.stem.position_m < 0.0501:
        moving.advance(PushingForce(push_n, (), rate_n_per_s), 1e-3)
        push_n += 1e-3 * rate_n_per_s
        most_n = max(most_n, moving.spring_n())
    return most_n


def test_the_breakaway_force_falls_as_the_force_grows_faster() -> None:
    """Canudas de Wit et al., section IV C."""
    found = [_breakaway_n(rate) for rate in (500.0, 2_000.0, 8_000.0)]
    assert F_S > found[0] > found[1] + 20.0 > found[2] + 40.0 > F_C + 39.0  # the fastest push slips at about F_c


def test_a_settled_stem_needs_one_step_for_an_hour() -> None:
    state = valve.step(PLANT, initial_state(PLANT, 1), 6.0, 0.5)
    state = valve.step(PLANT, state, 6.0, 0.5)
    later = valve.step(PLANT, state, 6.0, 3600.0)
    assert later.stem is state.stem
    assert later.time_s == 3601.0
    assert later.stem.direction == 0
    push_n = 0.06452 * 5171.06775 * 6.0
    assert friction_n(PLANT, later) == pytest.approx(push_n - 52538.0 * later.stem.position_m, abs=0.01)


def test_counters_follow_the_stick_velocity() -> None:
    state = initial_state(PLANT, 1)
    for current_ma in (8.0, 12.0, 6.0):
        state = valve.step(quiet("lugre", 0.05), state, current_ma, 1.0)
        assert state.stem.direction == 0
    assert (state.stem.slips, state.stem.stops, state.stem.reversals) == (3, 3, 1)


def test_the_stem_stays_between_its_stops_and_comes_off_again() -> None:
    stops = {"travel_min_m": 0.04, "travel_max_m": 0.08, "initial_position_m": 0.05}
    settings = quiet("lugre", 0.0, valve=stops)
    state = initial_state(settings, 1)
    for current_ma, place_m in ((24.0, 0.08), (0.0, 0.04)):
        state = valve.step(settings, state, current_ma, 0.5)
        assert state.stem.position_m == place_m
        assert state.stem.velocity_m_per_s == 0.0
    state = valve.step(settings, state, 12.0, 0.5)
    balance_m = 0.06452 * 5171.06775 * 12.0 / 52538.0
    assert 0.04 < state.stem.position_m < 0.08
    assert abs(state.stem.position_m - balance_m) < F_S / 52538.0


def _variant(name: str) -> PlantSettings:
    tables: dict[str, dict[str, Any]] = {
        "process": {"process": {"noise_n": 60.0, "sine_n": 100.0, "sine_hz": 1.0}},
        "feedback": {"sensor": {"backlash_m": 0.001, "time_constant_s": 0.01, "noise_of_reading": 0.0}},
        "schedule": {"schedule": [{"at_s": 0.2, "key": "valve.spring_rate_n_per_m", "factor": 1.1}]},
        "packing": {
            "packing": {"place_fraction": 0.3, "direction_fraction": 0.1},
            "stochastic": {"friction_fraction": 0.2},
        },
    }
    return plant_settings("lugre", {"sensor": {"noise_of_reading": 0.0}, **tables[name]})


@pytest.mark.parametrize("name", ["process", "feedback", "schedule", "packing"])
def test_all_else_in_the_plant_works_with_it(name: str) -> None:
    settings = _variant(name)
    plain, state = initial_state(PLANT, 1), initial_state(settings, 1)
    for current_ma in (8.0, 12.0, 9.0):
        for _ in range(100):
            plain, state = valve.step(PLANT, plain, current_ma, 2e-3), valve.step(settings, state, current_ma, 2e-3)
    _, shown_m = valve.measure(settings, state)
    apart_m = shown_m - plain.stem.position_m
    assert 1e-4 < abs(apart_m) < 0.01
    if name == "feedback":
        assert apart_m == pytest.approx(-0.0005, abs=2e-5)  # the last slip opened


@pytest.mark.parametrize(
    ("tables", "says"),
    [
        ({"packing": {"growth_per_decade": 0.1}}, "friction.model = 'lugre' knows no growth of F_s"),
        ({"valve": {"coulomb_friction_n": 0.0}}, "needs a valve.coulomb_friction_n above 0"),
        ({"friction": {"element_forces": [0.5, 0.5]}}, "element_forces and element_stiffnesses must have as many"),
        ({"friction": {"element_forces": [0.5, 0.2, 0.1, 0.1]}}, "element_forces must add up to 1, not 0.9"),
        ({"friction": {"model": "dahl"}}, "karnopp"),
    ],
)
def test_what_the_models_cannot_do_is_refused(tables: dict[str, dict[str, object]], says: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        plant_settings("lugre", tables)
    assert says in str(caught.value)
