"""The law `nmpc` on the emulated valve with actuator lag, in one process: short dwells, bands with two sides."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from positioner.bench.inprocess import configure
from positioner.bench.metrics import Totals, totals
from positioner.bench.scenario import Scenario
from positioner.laws.law import Observation
from positioner.laws.nmpc.lagged.law import LaggedLaw
from positioner.laws.nmpc.lagged.rest import LaggedRest
from positioner.laws.nmpc.law import NmpcLaw
from positioner.studies.direct import play_directly
from positioner.valve.state import StemState
from positioner.valve.stiction import StictionTable
from positioner.wire.messages import Motion

QUIET = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}
NOISY = {"noise_of_reading": 0.02, "noise_of_span": 0.0}


def scenario(lag_s: float, noise: dict[str, float], dwell_s: float = 1.5, **valve: Any) -> Scenario:
    lags = {"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s}
    return Scenario(
        name="lag",
        title="actuator lag",
        law="nmpc-predictive",
        seed=7,
        setpoints_mm=(73.0, 87.0, 80.0, 81.5),
        dwell_s=dwell_s,
        plant={"preset": "paper", "actuator": lags, "sensor": noise},
        valve={"actuator": lags, **valve},
        estimator=noise,
    )


def figures(lag_s: float, noise: dict[str, float], dwell_s: float = 1.5) -> Totals:
    return totals(list(play_directly(scenario(lag_s, noise, dwell_s)))[1:])


@pytest.mark.parametrize("lag_s", [0.002, 0.01, 0.05])
def test_a_quiet_sensor_lets_it_hold_a_thousandth_of_the_span(lag_s: float) -> None:
    found = figures(lag_s, QUIET)

    assert 0.001 < found.mean_abs_error_pct < 0.1
    assert found.unsettled_1pct == 0
    assert found.limit_cycles == 0


@pytest.mark.parametrize("lag_s", [0.02, 0.1])
def test_a_sensor_with_two_percent_noise_lets_it_hold_three_thousandths(lag_s: float) -> None:
    found = figures(lag_s, NOISY, dwell_s=2.5)

    assert 0.01 < found.mean_abs_error_pct < 0.3
    assert found.limit_cycles == 0


def test_twenty_readings_show_the_noise_before_the_first_move() -> None:
    law, table, motions = configure(scenario(0.02, QUIET)).make_law(), StictionTable(), list[Motion]()
    memory = law.begin(0.073)
    for sample in range(25):
        seen = Observation(0.073, 11.5, 1e-3, 0.087, sample * 1e-3)
        memory, estimate = law.estimate(memory, seen)
        memory, decision = law.decide(memory, estimate.stem, seen, table)
        motions.append(decision.motion)

    assert motions == [Motion.REST] * 19 + [Motion.MOVE] * 6


def test_a_setpoint_that_creeps_is_followed() -> None:
    steps = tuple(73.0 + 0.05 * min(step, 60) for step in range(90))
    found = list(play_directly(replace(scenario(0.01, QUIET, dwell_s=0.05), setpoints_mm=steps)))

    assert 0.0 < found[-1].mean_abs_error_pct < 0.15


def test_a_valve_without_lag_gets_the_law_without_pressure() -> None:
    assert isinstance(configure(scenario(0.0, QUIET)).make_law(), NmpcLaw)
    assert isinstance(configure(scenario(0.01, QUIET)).make_law(), LaggedLaw)
    assert isinstance(configure(scenario(0.0, QUIET, sensor_time_constant_s=0.01)).make_law(), LaggedLaw)


@pytest.mark.parametrize(
    ("tolerances", "sigma_m", "readings", "stays", "motion"),
    [
        (1.5, 1e-5, 50, False, Motion.MOVE),
        (0.9, 1e-5, 50, False, Motion.REST),
        (1.5, 2e-4, 50, False, Motion.REST),
        (1.5, 6e-5, 50, False, Motion.REST),
        (1.5, 6e-5, 1100, False, Motion.MOVE),
        (1.5, 2e-4, 1100, False, Motion.REST),
        (5.0, 1e-4, 50, False, Motion.MOVE),
        (1.5, 1e-5, 50, True, Motion.REST),
        (2.5, 1e-5, 50, True, Motion.MOVE),
    ],
)
def test_an_error_is_judged_once_and_a_stem_that_stays_moves_for_a_far_larger_one_only(
    tolerances: float, sigma_m: float, readings: int, stays: bool, motion: Motion
) -> None:
    law = configure(scenario(0.02, QUIET)).make_law()
    assert isinstance(law, LaggedLaw)
    setpoint_m = 0.080
    error_m = tolerances * law.lagged.tolerance_m(0.0005 * law.valve.span_m)
    rest = LaggedRest(setpoint_m - error_m, sigma_m * sigma_m, readings=readings, stays=stays)
    memory = law.begin(rest.x)
    belief = replace(memory.belief, seen=1)
    memory = replace(memory, stem=rest, belief=belief, setpoint_m=setpoint_m, anchor_m=setpoint_m)

    memory, decision = law.decide(
        memory,
        StemState(rest.x, 0.0, stuck=True, direction=1.0),
        Observation(rest.x, 11.5, 1e-3, setpoint_m, 1.0),
        StictionTable(),
    )

    assert decision.motion is motion
    is_certain = sigma_m < 2e-5
    if motion is Motion.REST:
        assert isinstance(memory.stem, LaggedRest)
        assert memory.stem.stays == is_certain


@pytest.mark.parametrize(("stiffer", "lag_s"), [(1.25, 0.01), (1.25, 0.1)])
def test_a_spring_stiffer_than_told_is_learned_in_the_first_moves(stiffer: float, lag_s: float) -> None:
    told = scenario(lag_s, QUIET)
    valve = {"spring_rate_n_per_m": stiffer * 52538.0, "initial_position_m": 0.07 / stiffer}
    setpoints_mm = tuple(nominal_mm / stiffer for nominal_mm in (72.0, 84.0, 78.0, 82.0, 76.0, 80.0))
    found = list(play_directly(replace(told, plant={**told.plant, "valve": valve}, setpoints_mm=setpoints_mm)))

    sums = totals(found[1:])
    assert 0.001 < sums.mean_abs_error_pct < 0.1
    assert sums.unsettled_1pct == 0
    assert 0.99 < (sums.travel_ratio or 0.0) < 1.4
