"""The chamber with mass flow against ISO 6358, closed forms, balances, and an independent integrator."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plant_emulator import valve
from plant_emulator.mass_flow import ATMOSPHERE_PA, flow_function, flow_m3_per_s
from plant_emulator.parameters import ActuatorSettings
from plant_emulator.presets import plant_settings
from plant_emulator.valve import held_state, initial_state
from positioner.errors import ConfigurationError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from plant_emulator.parameters import PlantSettings

AREA, GAIN, SPRING, MASS, F_V = 0.06452, 5171.06775, 52538.0, 1.361, 612.9
C, SUPPLY, B, V_0, V_2, OPENING = 1e-7, 240e3 + 101325.0, 0.5, 1e-3, 2e-3, 5e3


def plant(index: float = 1.4, **tables: Any) -> PlantSettings:
    """Return the paper's valve behind a booster, without dry friction unless `tables` has it."""
    smooth = {"static_friction_n": 0.0, "coulomb_friction_n": 0.0}
    tables["valve"] = {**smooth, **tables.get("valve", {})}
    tables["chamber"] = {"polytropic_index": index, **tables.get("chamber", {})}
    return plant_settings("mass-flow-booster", {"sensor": {"noise_of_reading": 0.0}, **tables})


STUCK = {"static_friction_n": 1e5, "coulomb_friction_n": 1e5}


def test_the_flow_function_is_that_of_iso_6358() -> None:
    for critical in (0.0, 0.2, 0.528):
        assert flow_function(0.5 * critical, critical) == flow_function(critical, critical) == 1.0
        ratio = 0.5 * (1.0 + critical)
        assert flow_function(ratio, critical) == pytest.approx(math.sqrt(0.75), rel=1e-12)
        assert flow_function(1.0, critical) == 0.0
        assert flow_function(0.9995, critical) == pytest.approx(0.5 * flow_function(0.999, critical), rel=1e-9)


def test_the_flow_is_choked_saturates_and_has_the_sign_of_the_difference() -> None:

    def flow(pressure_pa: float, commanded_pa: float) -> float:
        return flow_m3_per_s(plant().chamber, 240e3, pressure_pa, commanded_pa)

    choked = flow(10e3, 200e3)
    assert choked == pytest.approx(C * SUPPLY, rel=1e-12)
    assert flow(60e3, 200e3) == choked  # constant below b
    assert flow(120e3, 200e3) < choked  # no longer above
    assert flow(10e3, 10e3 + 0.25 * OPENING) == pytest.approx(0.25 * choked, rel=1e-12)
    assert flow(200e3, 100e3) == pytest.approx(-C * (200e3 + ATMOSPHERE_PA), rel=1e-12)
    assert flow(200e3, 200e3) == 0.0


@pytest.mark.parametrize("index", [1.0, 1.4])
def test_a_choked_filling_at_constant_volume_is_linear(index: float) -> None:
    settings = plant(index, valve=STUCK)
    state = initial_state(settings, 1)
    volume_m3, begun_pa = V_0 + AREA * 0.01, state.actuator.pressure_pa
    rate = index * C * 100e3 * SUPPLY / volume_m3
    for seconds in (0.001, 0.004, 0.01):
        filled = valve.step(settings, state, 20.0, seconds)
        assert filled.actuator.pressure_pa == pytest.approx(begun_pa + rate * seconds, abs=1e-6)
        assert (filled.actuator.pressure_pa + ATMOSPHERE_PA) / SUPPLY < B


@pytest.mark.parametrize("index", [1.0, 1.4])
def test_a_choked_venting_at_constant_volume_is_exponential(index: float) -> None:
    settings = plant(index, valve=STUCK)
    state = held_state(settings, 1, 24.0)
    volume_m3, begun_pa = V_0 + AREA * 0.01, state.actuator.pressure_pa + ATMOSPHERE_PA
    for seconds in (0.002, 0.005):
        vented = valve.step(settings, state, 0.0, seconds)
        expected_pa = begun_pa * math.exp(-index * C * 100e3 / volume_m3 * seconds)
        assert ATMOSPHERE_PA / expected_pa < B
        assert vented.actuator.pressure_pa + ATMOSPHERE_PA == pytest.approx(expected_pa, rel=2e-6)


@pytest.mark.parametrize("preset", ["mass-flow", "mass-flow-booster", "mass-flow-lugre"])
def test_in_the_end_the_pressure_is_the_commanded_one(preset: str) -> None:
    settings = plant_settings(preset)
    for current_ma in (9.0, 6.0):
        state = initial_state(settings, 1)
        for _ in range(3):
            state = valve.step(settings, state, current_ma, 5.0)
        gain = settings.valve.pressure_gain_pa_per_ma
        assert state.actuator.pressure_pa == pytest.approx(gain * current_ma, rel=1e-6)


@pytest.mark.parametrize("current_ma", [6.0, 12.0])
def test_in_the_end_two_chambers_have_the_commanded_pressure_between_them(current_ma: float) -> None:
    settings = plant_settings("mass-flow-booster", {"chamber": {"double_acting": True}})
    state = held_state(settings, 1, 9.0)
    assert state.actuator.opposing_pa == pytest.approx(0.5 * (240e3 - 9.0 * GAIN), rel=1e-9)
    state = valve.step(settings, state, current_ma, 5.0)
    assert state.actuator.pressure_pa == pytest.approx(GAIN * current_ma, rel=1e-6)
    assert state.actuator.opposing_pa == pytest.approx(0.5 * (240e3 - GAIN * current_ma), rel=1e-6)


@pytest.mark.parametrize("index", [1.0, 1.4])
def test_a_stuck_stem_lets_the_opposing_chamber_vent_choked(index: float) -> None:
    """Where the spool is fully open, and down to half of the supply: p_2 falls as a choked venting alone."""
    settings = plant(index, valve=STUCK, chamber={"double_acting": True})
    state = initial_state(settings, 1)
    volume_m3, begun_pa = 1e-3 + AREA * (0.1397 - 0.01), state.actuator.opposing_pa + ATMOSPHERE_PA
    for seconds in (0.001, 0.003):
        vented_pa = valve.step(settings, state, 20.0, seconds).actuator.opposing_pa + ATMOSPHERE_PA
        expected_pa = begun_pa * math.exp(-index * C * 100e3 / volume_m3 * seconds)
        assert ATMOSPHERE_PA / expected_pa < B
        assert begun_pa - vented_pa > 200.0
        assert vented_pa == pytest.approx(expected_pa, rel=2e-6)


@pytest.mark.parametrize("index", [1.0, 1.4])
def test_air_that_is_shut_in_is_a_spring(index: float) -> None:
    """p·Vⁿ stays, and the forces balance: 500 N of the process come, and the spool lets next to no air pass."""
    settings = plant(
        index,
        chamber={"fill_conductance_m3_per_s_pa": 1e-12, "vent_conductance_m3_per_s_pa": 1e-12},
        schedule=[{"at_s": 0.01, "key": "process.force_n", "value": -500.0}],
        valve={"viscous_friction_n_s_per_m": 5000.0, "initial_position_m": 0.05},
    )
    state = initial_state(settings, 1)
    before_pa, before_m3 = state.actuator.pressure_pa + ATMOSPHERE_PA, V_0 + AREA * 0.05
    state = valve.step(settings, state, 0.05 * SPRING / AREA / GAIN, 0.5)
    x, pressure_pa = state.stem.position_m, state.actuator.pressure_pa
    assert 0.0503 < x < 0.055
    held = (pressure_pa + ATMOSPHERE_PA) * (V_0 + AREA * x) ** index
    assert held == pytest.approx(before_pa * before_m3**index, rel=6e-5)
    assert AREA * pressure_pa + 500.0 == pytest.approx(SPRING * x, rel=1e-5)


MOVES = ((8.0, 0.1), (6.0, 0.05), (14.0, 0.15), (4.0, 0.2))


def _integrated(index: float, lag_s: float, *, double: bool = False) -> NDArray[np.float64]:
    """Return position and net pressure after each ms of `MOVES` by SciPy's Radau, from equations written here anew."""

    def air(p: float, wanted: float) -> float:
        opening = min(max((wanted - p) / OPENING, -1.0), 1.0)
        upper, ratio = (SUPPLY, p / SUPPLY) if opening > 0.0 else (p, 101325.0 / p)
        part = max(ratio - B, 0.0) / (1.0 - B)
        return opening * C * 100e3 * upper * math.sqrt(max(1.0 - part * part, 0.0))

    def slopes(t: float, y: NDArray[np.float64], wanted_pa: float, before_pa: float) -> list[float]:
        x, v, p, q = y
        w = wanted_pa + (before_pa - wanted_pa) * (math.exp(-t / lag_s) if lag_s else 0.0)
        wanted, q_slope = w + 101325.0, 0.0
        if double:
            wanted = 0.5 * (SUPPLY + 101325.0 + w)
            q_slope = index * (air(q, 0.5 * (SUPPLY + 101325.0 - w)) + q * AREA * v) / (V_2 + AREA * (0.1397 - x))
        pull = SPRING * x + F_V * v
        return [v, (AREA * (p - q) - pull) / MASS, index * (air(p, wanted) - p * AREA * v) / (V_0 + AREA * x), q_slope]

    net = SPRING * 0.01 / AREA
    q = 0.5 * (SUPPLY + 101325.0 - net) if double else 101325.0
    y, w, found = [0.01, 0.0, net + q, q], net, []
    for current_ma, seconds in MOVES:
        ends = np.arange(1, round(seconds / 1e-3) + 1) * 1e-3
        solved = solve_ivp(
            slopes, (0.0, ends[-1]), y, "Radau", ends, args=(GAIN * current_ma, w),
            rtol=1e-8, atol=[1e-10, 1e-8, 1e-4, 1e-4], max_step=2e-3,
        )  # fmt: skip
        found.append((solved.y[0], solved.y[2] - solved.y[3]))
        y = list(solved.y[:, -1])
        w = GAIN * current_ma + (w - GAIN * current_ma) * (math.exp(-seconds / lag_s) if lag_s else 0.0)
    return np.concatenate(found, axis=1)


def _played(settings: PlantSettings, period_s: float) -> NDArray[np.float64]:
    state, found = initial_state(settings, 1), []
    for current_ma, seconds in MOVES:
        for _ in range(round(seconds / period_s)):
            state = valve.step(settings, state, current_ma, period_s)
            found.append((state.stem.position_m, state.actuator.pressure_pa))
    return np.array(found).T


@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize(("index", "lag_s"), [(1.0, 0.0), (1.4, 0.01)])
def test_moves_are_those_of_an_independent_integrator(index: float, lag_s: float, *, double: bool) -> None:
    chamber = {"double_acting": double, "opposing_dead_volume_m3": V_2}
    settings = plant(index, actuator={"converter_time_constant_s": lag_s}, chamber=chamber)
    (ours_m, ours_pa), (theirs_m, theirs_pa) = _played(settings, 1e-3), _integrated(index, lag_s, double=double)
    assert 0.04 < np.ptp(theirs_m) < 0.12
    assert np.abs(ours_m - theirs_m).max() < 6e-5
    assert np.abs(ours_pa - theirs_pa).max() < 100.0


@pytest.mark.parametrize("period_s", [2e-4, 5e-3])
def test_the_result_hardly_depends_on_how_the_time_is_divided(period_s: float) -> None:
    one, other = _played(plant(), 1e-3), _played(plant(), period_s)
    if period_s < 1e-3:
        other = other[:, 4::5]
    else:
        one = one[:, 4::5]
    assert np.abs(one[0] - other[0]).max() < 2e-5


@pytest.mark.parametrize(
    "tables",
    [
        {"process": {"noise_n": 60.0, "sine_n": 100.0, "sine_hz": 1.0}},
        {"actuator": {"dead_time_s": 0.0123, "hysteresis_ma": 0.2}},
        {"sensor": {"backlash_m": 0.001, "time_constant_s": 0.01}},
        {"schedule": [{"at_s": 0.5, "key": "actuator.supply_pa", "value": 60e3}]},
        {"friction": {"model": "maxwell-slip"}},
    ],
)
def test_all_else_in_the_plant_works_with_it(tables: dict[str, Any]) -> None:
    plain_settings, settings = plant_settings("mass-flow-booster"), plant_settings("mass-flow-booster", tables)
    plain, state = initial_state(plain_settings, 1), initial_state(settings, 1)
    apart_m = 0.0
    for current_ma in (8.0, 12.0, 18.0, 9.0):
        for _ in range(100):
            plain = valve.step(plain_settings, plain, current_ma, 2e-3)
            state = valve.step(settings, state, current_ma, 2e-3)
            shown_m = state.stem.position_m if state.feedback is None else state.feedback.shown_m
            apart_m = max(apart_m, abs(shown_m - plain.stem.position_m))
    assert 1e-4 < apart_m < 0.1
    assert 0.0 <= state.stem.position_m <= 0.1397


def test_a_second_chamber_needs_a_mass_flow_and_stays() -> None:
    with pytest.raises(ConfigurationError, match="double_acting needs"):
        plant_settings("paper", {"chamber": {"double_acting": True}})
    with pytest.raises(ConfigurationError, match="double_acting' cannot change"):
        plant(schedule=[{"at_s": 1.0, "key": "chamber.double_acting", "value": 1.0}])


def test_a_supply_that_is_too_low_ends_the_pressure() -> None:
    settings = plant(actuator={"supply_pa": 60e3})
    state = valve.step(settings, initial_state(settings, 1), 20.0, 5.0)
    assert state.actuator.pressure_pa == pytest.approx(60e3, rel=1e-3)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"supply_pa": 0.0}, "needs a supply_pa above 0"),
        ({"fill_time_constant_s": 0.1}, "makes its own lag of conductance and volume"),
        ({"slew_pa_per_s": 1e5}, "makes its own lag of conductance and volume"),
        ({"model": "orifice"}, "mass-flow"),
    ],
)
def test_what_does_not_belong_to_it_is_refused(values: dict[str, object], says: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        plant_settings("mass-flow-booster", {"actuator": values})
    assert says in str(caught.value)


def test_the_lag_model_needs_nothing_of_it() -> None:
    assert ActuatorSettings().model == "lag"
