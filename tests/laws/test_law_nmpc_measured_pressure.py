"""The measured pressure in the law `nmpc`: weighted by its noise, and disregarded where it cannot be true."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from plant_emulator import valve
from plant_emulator.presets import plant_settings
from positioner.bench.inprocess import configure
from positioner.bench.scenario import Scenario
from positioner.laws.law import Observation
from positioner.laws.nmpc.lagged.drive import drive_of
from positioner.laws.nmpc.lagged.law import LaggedLaw
from positioner.laws.nmpc.lagged.measured import MeasuredPressure, unmeasured
from positioner.laws.nmpc.lagged.pipeline import pipeline_at
from positioner.laws.nmpc.lagged.supply import NO_RISE
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.laws.nmpc.lagged.memory import LaggedMemory

    Reported = Callable[[float, float], float | None]

PERIOD_S = 1e-3
QUIET = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}
SETPOINTS_MM = (73.0, 87.0, 80.0, 81.5)


def scenario(lag_s: float, told_s: float, **plant: Any) -> Scenario:
    lags = {"fill_time_constant_s": lag_s, "vent_time_constant_s": lag_s}
    told = {"fill_time_constant_s": told_s, "vent_time_constant_s": told_s}
    return Scenario(
        name="pressure",
        title="measured pressure",
        law="nmpc-predictive",
        seed=7,
        setpoints_mm=SETPOINTS_MM,
        dwell_s=1.0,
        plant={
            "preset": "paper",
            "valve": {"initial_position_m": 0.06},
            "actuator": {**lags, **plant},
            "sensor": QUIET,
        },
        valve={"actuator": told},
        estimator=QUIET,
    )


def played(own: Scenario, reported: Reported) -> tuple[LaggedMemory, list[float], list[str], list[float]]:
    """Return the memory at the end, the currents, the notices, and the errors in mm at the end of each dwell.

    `reported` makes of time and true pressure in Pa what the sensor says.
    """
    configuration, settings = configure(own), plant_settings(overrides=own.plant)
    law = configuration.make_law()
    assert isinstance(law, LaggedLaw)
    plant, memory, applied_ma, time_s = valve.initial_state(settings, own.seed), None, 0.0, 0.0
    currents, notices, errors = [], [], []
    for setpoint_mm in own.setpoints_mm:
        for _ in range(own.samples_per_dwell):
            plant, measured_m = valve.measure(settings, plant)
            if memory is None:
                memory, applied_ma = law.begin(measured_m), configuration.valve.balance_current_ma(measured_m)
            pressure_pa = reported(time_s, plant.actuator.pressure_pa)
            is_new = pressure_pa is not None
            seen = Observation(
                measured_m, applied_ma, PERIOD_S, 1e-3 * setpoint_mm, time_s, pressure_pa, pressure_is_new=is_new
            )
            memory, estimate = law.estimate(memory, seen)
            memory, decision = law.decide(memory, estimate.stem, seen, StictionTable())
            notices += [decision.fallback] if decision.fallback else []
            applied_ma = round(decision.current_ma, 3)
            currents.append(applied_ma)
            plant = valve.step(settings, plant, applied_ma, PERIOD_S)
            time_s += PERIOD_S
        errors.append(abs(1e3 * plant.stem.position_m - setpoint_mm))
    assert memory is not None
    return memory, currents, notices, errors


def noisy(fraction: float) -> Reported:
    draw = np.random.default_rng(5)
    return lambda _time_s, true_pa: true_pa * (1.0 + fraction * float(draw.normal()))


def moved(variance_ma2: float) -> tuple[MeasuredPressure, MeasuredPressure, float]:
    """Return a filter whose pressure rises, the same after a reading of 9.1 for 9.0 mA, and the corrected pressure."""
    own = drive_of(ActuatorParameters(fill_time_constant_s=0.05, vent_time_constant_s=0.05), PERIOD_S, 4.0, 20.0)
    measured = replace(unmeasured(0.04), pp=0.1, oo=0.0).later(own, 8.8, 9.0)
    measured = replace(measured, oo=0.0)
    after, pressure_ma = measured.corrected(9.0, 9.1, variance_ma2, 0.0)
    return measured, after, pressure_ma


def test_a_sensor_without_noise_is_believed() -> None:
    _, after, pressure_ma = moved(0.0)

    assert pressure_ma == pytest.approx(9.1, abs=1e-12)
    assert after.pp == pytest.approx(0.0, abs=1e-12)


def test_a_sensor_with_endless_noise_changes_nothing() -> None:
    before, after, pressure_ma = moved(1e40)

    assert pressure_ma == 9.0
    assert after == before


def test_between_them_the_variances_are_the_weights() -> None:
    before, after, pressure_ma = moved(0.3)

    weight = before.pp / (before.pp + 0.3)
    assert pressure_ma == pytest.approx(9.0 + weight * 0.1, rel=1e-9)
    assert after.pp == pytest.approx(0.3 * weight, rel=1e-9)


@pytest.mark.parametrize("current_ma", [19.0, 5.0])
def test_its_covariance_is_that_of_wrong_lags(current_ma: float) -> None:
    def after_a_while(lag_s: float) -> tuple[float, MeasuredPressure]:
        actuator = ActuatorParameters(fill_time_constant_s=lag_s, vent_time_constant_s=lag_s)
        own = drive_of(actuator, PERIOD_S, 4.0, 20.0)
        line, measured = pipeline_at(10.0, 0.0, 0.0, PERIOD_S), unmeasured(1.0)
        for _ in range(12):
            after = line.after(own, current_ma)
            line, measured = after, measured.later(own, line.pressure_ma, after.pressure_ma)
        return line.pressure_ma, measured

    by_multiple = (after_a_while(0.020002)[0] - after_a_while(0.019998)[0]) / 2e-4
    _, measured = after_a_while(0.02)

    assert (measured.pf if current_ma > 10.0 else measured.pv) == pytest.approx(by_multiple, rel=1e-3)
    assert abs(by_multiple) > 0.5


def test_a_sensor_of_pure_noise_leaves_every_current_as_it_is() -> None:
    own = scenario(0.05, 0.05)

    _, without, _, _ = played(own, lambda _time_s, _true_pa: None)
    _, currents, notices, _ = played(own, noisy(1.0))

    assert currents == without
    assert notices == []


def test_it_tells_the_lags_that_nobody_told() -> None:
    memory, _, notices, errors = played(scenario(0.05, 0.07), noisy(0.005))

    assert memory.drive.fill_s == pytest.approx(0.05, rel=0.03)
    assert memory.drive.vent_s == pytest.approx(0.05, rel=0.03)
    assert notices == []
    assert max(errors) < 0.15


def test_offset_and_gain_of_the_sensor_do_no_harm() -> None:
    exact = noisy(0.005)

    memory, _, notices, errors = played(
        scenario(0.05, 0.05), lambda time_s, pa: 1.02 * (exact(time_s, pa) or 0.0) + 2e3
    )

    assert memory.measured is not None
    assert memory.measured.trusted
    assert memory.drive.fill_s == pytest.approx(0.05, rel=0.05)
    assert notices == []
    assert max(errors) < 0.15


def frozen(exact: Reported) -> Reported:
    seen: list[float] = []

    def reported(time_s: float, true_pa: float) -> float | None:
        if time_s < 1.5:
            seen[:] = [exact(time_s, true_pa) or 0.0]
        return seen[0]

    return reported


def jumped(exact: Reported) -> Reported:
    return lambda time_s, true_pa: (exact(time_s, true_pa) or 0.0) + (1.5e4 if time_s > 1.5 else 0.0)


@pytest.mark.parametrize("fault", [frozen, jumped])
def test_a_sensor_that_freezes_or_jumps_is_disregarded_with_one_line(fault: Callable[[Reported], Reported]) -> None:
    memory, _, notices, errors = played(scenario(0.05, 0.05), fault(noisy(0.005)))

    assert notices == ["the measured pressure contradicts the commands, and is not used"]
    assert memory.measured is not None
    assert not memory.measured.trusted
    assert max(errors) < 0.15


def test_a_few_bad_readings_change_nothing_much() -> None:
    exact, count = noisy(0.005), iter(range(10**6))
    memory, _, notices, errors = played(
        scenario(0.05, 0.05), lambda time_s, pa: 0.0 if next(count) % 50 == 0 else exact(time_s, pa)
    )

    assert notices == []
    assert memory.measured is not None
    assert memory.measured.trusted
    assert max(errors) < 0.15


def test_a_sensor_that_recovers_is_used_again() -> None:
    exact = noisy(0.005)

    memory, _, notices, _ = played(
        scenario(0.05, 0.05), lambda time_s, pa: (exact(time_s, pa) or 0.0) + (1.5e4 if 0.6 < time_s < 0.8 else 0.0)
    )

    assert len(notices) == 2
    assert notices[1] == "the measured pressure fits the commands, and is used again"
    assert memory.measured is not None
    assert memory.measured.trusted


@pytest.mark.parametrize("true_lag", [0.8, 1.0, 1.3])
def test_the_end_of_a_rise_is_told_before_it_is_reached(true_lag: float) -> None:
    own = drive_of(ActuatorParameters(fill_time_constant_s=0.1, vent_time_constant_s=0.1), PERIOD_S, 4.0, 20.0)
    share, rise, pressure_ma, end_ma = -math.expm1(-PERIOD_S / (0.1 * true_lag)), NO_RISE, 8.0, None
    while end_ma is None:
        rise, end_ma = rise.after(own, pressure_ma, 20.0, 20.0, 1e-3)
        pressure_ma += share * (15.0 - pressure_ma)

    assert 15.0 < end_ma < 15.6
    assert pressure_ma < 13.5


def test_a_rise_to_its_current_has_no_other_end() -> None:
    own, rise = (
        drive_of(ActuatorParameters(fill_time_constant_s=0.1, vent_time_constant_s=0.1), PERIOD_S, 4.0, 20.0),
        NO_RISE,
    )
    pressure_ma = 8.0
    for _ in range(1000):
        rise, end_ma = rise.after(own, pressure_ma, 18.0, 18.0, 1e-3)
        pressure_ma += 0.0075 * (18.0 - pressure_ma)
        assert end_ma is None


def test_a_low_supply_is_told_once_and_lowers_the_highest_current() -> None:
    low_pa = 15.0 * plant_settings("paper").valve.pressure_gain_pa_per_ma
    own = replace(scenario(0.1, 0.1, supply_pa=low_pa), setpoints_mm=(60.0, 61.8, 60.8, 60.0, 61.4))

    memory, _, notices, errors = played(own, noisy(0.005))

    assert 1 <= len(notices) <= 3
    assert "check the air supply" in notices[0]
    assert 14.9 < memory.drive.high_ma < 17.5
    # until the end of the supply is known, one dwell may end in a correction
    assert sum(error_mm > 0.15 for error_mm in errors) <= 1
    assert max(errors[3:]) < 0.15
