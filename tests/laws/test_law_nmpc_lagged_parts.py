"""The parts of the law `nmpc` for a valve with lag, against closed forms and independent computations."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from positioner.laws.nmpc.lagged.brake import stopping_current_ma
from positioner.laws.nmpc.lagged.drive import Drive, drive_of
from positioner.laws.nmpc.lagged.onset import Onset, OnsetBank
from positioner.laws.nmpc.lagged.pipeline import pipeline_at
from positioner.laws.nmpc.lagged.regression import OnsetRegression
from positioner.laws.nmpc.lagged.rest import LaggedRest
from positioner.laws.nmpc.lagged.sensor_lag import sensor_lag
from positioner.laws.nmpc.lagged.slip import Slip, StemModel
from positioner.laws.nmpc.lagged.slip_filter import SlipCovariance, SlipState, advanced
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.motion import Load, MotionModel
from positioner.valve.parameters import ValveParameters

PERIOD_S = 1e-3
VALVE = ValveParameters(id="paper")


def drive(lag_s: float, **more: float) -> Drive:
    actuator = ActuatorParameters(fill_time_constant_s=lag_s, vent_time_constant_s=lag_s, **more)
    return drive_of(actuator, PERIOD_S, 4.0, 20.0)


def slip(lag_s: float, direction: float = 1.0) -> Slip:
    spring, static, sliding = VALVE.spring_rate_n_per_m, VALVE.static_friction_n, VALVE.coulomb_friction_n
    return Slip(StemModel.of(VALVE), drive(lag_s), direction, spring, static, sliding)


@pytest.mark.parametrize("lag_s", [0.0, 0.002, 0.05])
def test_the_deadbeat_current_brings_the_pressure_there_in_one_sample(lag_s: float) -> None:
    own = drive(lag_s)
    wanted_ma = 12.0 + 0.1 * (1.0 if lag_s else 60.0)

    after_ma, _ = own.after(12.0, 12.0, own.command_ma(12.0, 12.0, wanted_ma))

    assert after_ma == pytest.approx(wanted_ma, abs=1e-9)


def test_behind_a_converter_the_deadbeat_currents_arrive_without_passing() -> None:
    own = drive(0.05, converter_time_constant_s=0.01)
    pressure_ma, converter_ma, course = 8.0, 8.0, []
    for _ in range(300):
        current_ma = own.command_ma(pressure_ma, converter_ma, 12.0)
        pressure_ma, converter_ma = own.after(pressure_ma, converter_ma, current_ma)
        course.append(pressure_ma)

    assert course[-1] == pytest.approx(12.0, abs=1e-3)
    assert max(course) < 12.02


def test_the_slew_limit_bounds_the_pressure() -> None:
    own = drive(0.01, slew_ma_per_s=100.0)

    assert own.after(8.0, 8.0, 20.0)[0] == pytest.approx(8.1, abs=1e-9)


def test_a_ramp_rises_at_its_rate() -> None:
    own = drive(0.02, converter_time_constant_s=0.005)
    pressure_ma = 10.0
    _, converter_ma = own.ramp_ma(pressure_ma, 1.0, 50.0)
    for _ in range(20):
        before_ma = pressure_ma
        current_ma, _ = own.ramp_ma(pressure_ma, 1.0, 50.0)
        pressure_ma, converter_ma = own.after(pressure_ma, converter_ma, current_ma)

    assert pressure_ma - before_ma == pytest.approx(50.0 * PERIOD_S, rel=0.02)


def test_a_dead_time_of_two_and_a_half_samples_mixes_two_currents() -> None:
    own, line = drive(0.0), pipeline_at(10.0, 0.0, 2.5 * PERIOD_S, PERIOD_S)
    seen = []
    for _ in range(5):
        line = line.after(own, 12.0)
        seen.append(line.pressure_ma)

    assert seen == pytest.approx([10.0, 10.0, 11.0, 12.0, 12.0])
    assert len(pipeline_at(10.0, 0.0, 2.5 * PERIOD_S, PERIOD_S).pending()) == 2


def test_the_derivative_of_the_pressure_to_the_lag_is_that_of_two_neighbours() -> None:
    def pressure_ma(lag_s: float) -> tuple[float, float]:
        own, line = drive(lag_s), pipeline_at(10.0, 0.0, 0.0, PERIOD_S)
        for current_ma in (20.0, 20.0, 4.0, 15.0):
            line = line.after(own, current_ma)
        return line.pressure_ma, line.by_lag

    difference = (pressure_ma(0.02002)[0] - pressure_ma(0.01998)[0]) / 4e-5

    assert pressure_ma(0.02)[1] == pytest.approx(difference, rel=1e-3)
    assert abs(difference) > 1.0


def test_without_lag_a_slip_is_that_of_the_closed_form() -> None:
    own = slip(0.0)
    model, load = MotionModel.of(VALVE), Load.of(VALVE)

    x, v, *_ = own.after(0.08, 0.3, 17.5, 17.5, 17.5)
    end = model.step(0.08, 0.3, 17.5, load, 1.0, PERIOD_S)
    stop_m = own.stop_m(0.08, 0.3, 12.0, 12.0, 12.0, 12.0)
    stop = model.step(0.08, 0.3, 12.0, load, 1.0, 60.0)

    assert x - 0.08 == pytest.approx(end.x - 0.08, rel=0.02)
    assert v == pytest.approx(end.v, rel=0.01)
    assert stop_m - 0.08 == pytest.approx(stop.x - 0.08, rel=0.15)


@pytest.mark.parametrize("lag_s", [0.005, 0.05, 0.3])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_current_found_by_shooting_stops_the_stem_at_its_target(lag_s: float, direction: float) -> None:
    own, x, v = slip(lag_s, direction), 0.08, direction * 0.3
    model = own.model
    pressure_ma = model.pressure_ma(own.spring_n_per_m * x + direction * 1650.0)
    brake_ma = model.pressure_ma(own.spring_n_per_m * x - direction * 850.0)
    planned = own.with_drive(own.drive.with_reserve(0.2, 0.4))

    def stop_m(current_ma: float) -> float:
        return planned.stop_m(x, v, pressure_ma, pressure_ma, current_ma, brake_ma)

    target_m = 0.5 * (stop_m(4.0) + stop_m(20.0))
    found_ma = stopping_current_ma(
        own,
        x,
        v,
        pressure_ma,
        pressure_ma,
        target_m,
        brake_ma,
        brake_ma,
        fastest_m_per_s=5.0,
        reserve=0.2,
        slew_reserve=0.4,
    )

    assert abs(stop_m(20.0) - stop_m(4.0)) > 2e-5
    assert stop_m(found_ma) == pytest.approx(target_m, abs=5e-6)
    assert 4.0 < found_ma < 20.0


def test_the_bank_weighs_its_hypotheses_as_bayes_rule_does() -> None:
    sigma_m, seen_m = 2e-4, (1e-4, 3e-4)
    paths = {0.1: (2e-4, 5e-4), 0.3: (1e-4, 2e-4)}
    bank = OnsetBank(tuple(Onset(0.0, 0.1, 0.0, 1700.0, 1.0, weight, 0.0) for weight in paths), sum(paths))
    for sample, seen in enumerate(seen_m):
        moved = zip(bank.onsets, paths.values(), strict=True)
        bank = replace(bank, onsets=tuple(replace(each, seen_m=path[sample]) for each, path in moved))
        bank = bank.scored(seen, sigma_m**2)

    def likelihood(path: tuple[float, ...]) -> float:
        return math.exp(-sum((a - b) ** 2 for a, b in zip(seen_m, path, strict=True)) / (2.0 * sigma_m**2))

    slipped = sum(weight * likelihood(path) for weight, path in paths.items())
    stuck = (1.0 - sum(paths)) * likelihood((0.0, 0.0))

    assert bank.probability() == pytest.approx(slipped / (slipped + stuck), rel=1e-6)


def test_the_bank_finds_when_the_stem_slipped() -> None:
    own, sensor, line = slip(0.02), sensor_lag(0.0, PERIOD_S), pipeline_at(12.6, 0.0, 0.0, PERIOD_S)
    bank, x, v, slipped_at = OnsetBank(), 0.08, 0.0, None
    rng = np.random.default_rng(4)
    for sample in range(200):
        before, line = line, line.after(own.drive, own.drive.ramp_ma(line.pressure_ma, 1.0, 60.0)[0])
        force_n = own.model.net_n(line.pressure_ma, own.spring_n_per_m, 0.08)
        if slipped_at is not None:
            x, v, *_ = own.after(x, v, before.pressure_ma, before.converter_ma, line.acting_ma)
        elif force_n > 1760.0:
            x, v = own.begun(0.08, line.pressure_ma, line.pressure_ma, 0.5 * PERIOD_S)
            slipped_at = sample
        bank = bank.advanced(own, sensor, before, line.acting_ma, 0.08, 0.05 * 1707.7)
        bank = bank.scored(x - 0.08 + 6e-5 * rng.standard_normal(), 36e-10)
        if bank.probability() > 0.99:
            break
    found = bank.summary()

    assert slipped_at is not None
    assert slipped_at < sample < slipped_at + 8
    assert found.force_n == pytest.approx(1760.0, rel=0.03)
    assert found.v == pytest.approx(v, rel=0.3)


def test_the_regression_is_that_of_least_squares() -> None:
    rng = np.random.default_rng(3)
    begin = OnsetRegression(
        52000.0, 1700.0, 1.0, 1400.0, 2000.0**2, 0.0, 0.0, 0.0, 150.0**2, 0.0, 0.0, 0.2**2, 0.0, 90.0**2
    )
    rows, values, found = [], [], begin
    for _ in range(12):
        x, s, by_lag_n = rng.uniform(0.06, 0.09), rng.choice([-1.0, 1.0]), rng.uniform(-400.0, 400.0)
        truth_n = 50000.0 * x + s * 1800.0 - by_lag_n * (1.1 - found.lag) + 5.0 * rng.standard_normal()
        rows.append([x, s, -by_lag_n, 0.0])
        values.append(truth_n - by_lag_n * found.lag)
        found = found.with_onset(x, s, by_lag_n, truth_n, 25.0)
        # a slip that shows F_c with an error of 5 N, beside an error of K
        shown_n = 1350.0 + s * x * (50000.0 - found.spring_n_per_m) + 5.0 * rng.standard_normal()
        rows.append([s * x, 0.0, 0.0, 1.0])
        values.append(shown_n + s * x * found.spring_n_per_m)
        before_n2 = found.slip_n2(x, s, 0.0)
        gain = before_n2 / (before_n2 + 25.0)
        found_n = found.sliding_n + gain * (shown_n - found.sliding_n)
        found = found.with_slip(x, s, 0.0, found_n, (1.0 - gain) * before_n2)
    prior = np.diag([1 / 2000.0, 1 / 150.0, 1 / 0.2, 1 / 90.0])
    left = np.vstack([prior, np.array(rows) / 5.0])
    right = np.concatenate([prior @ [52000.0, 1700.0, 1.0, 1400.0], np.array(values) / 5.0])
    expected = np.linalg.lstsq(left, right, rcond=None)[0]

    known = [found.spring_n_per_m, found.static_n, found.lag, found.sliding_n]
    assert known == pytest.approx(list(expected), rel=1e-6)
    covariance = np.linalg.inv(left.T @ left)
    assert [found.kk, found.kc, found.fc, found.cc] == pytest.approx(
        [covariance[0, 0], covariance[0, 3], covariance[1, 3], covariance[3, 3]], rel=1e-5
    )


def test_the_average_at_rest_separates_the_lag_of_the_sensor() -> None:
    sensor = sensor_lag(0.02, PERIOD_S)
    rest, rows, values = LaggedRest(0.08, 1e-6, 0.001, 0.0, 1e-6), [], []
    for sample in range(1, 40):
        rest = rest.later(sensor, PERIOD_S)
        seen_m = 0.0805 + 0.0006 * math.exp(-sample * PERIOD_S / 0.02)
        rest = rest.averaged(seen_m, 1e-8)
        rows.append([1.0, math.exp(-sample * PERIOD_S / 0.02)])
        values.append(seen_m)
    left = np.vstack([np.eye(2) / 1e-3, np.array(rows) / 1e-4])
    expected = np.linalg.lstsq(left, np.concatenate([np.array([0.08, 0.001]) / 1e-3, np.array(values) / 1e-4]))[0]

    assert rest.x == pytest.approx(expected[0], abs=1e-9)
    assert rest.xx == pytest.approx(np.linalg.inv(left.T @ left)[0, 0], rel=1e-6)


def test_the_filter_of_a_slip_propagates_and_corrects_as_kalman_s_equations_say() -> None:
    own, sensor, line = slip(0.02), sensor_lag(0.004, PERIOD_S), pipeline_at(17.6, 0.0, 0.0, PERIOD_S)
    names = ["xx", "xv", "xf", "xy", "vv", "vf", "vy", "ff", "fy", "yy"]
    root = np.array([[3e-4, 0, 0, 0], [0.01, 0.05, 0, 0], [5.0, 3.0, 40.0, 0], [2e-4, 1e-5, 1e-5, 1e-4]])
    prior = root @ root.T
    entries = dict(zip(names, prior[np.triu_indices(4)], strict=True))
    before = SlipState(0.08, 0.3, 1423.0, 0.0795, SlipCovariance(**entries))

    def flow(z: np.ndarray) -> np.ndarray:
        state = SlipState(z[0], z[1], z[2], z[3], before.covariance)
        end, _ = advanced(state, own.with_sliding(z[2]), sensor, line, 17.0, 0.0, 0.0)
        return np.array([end.x, end.v, end.sliding_n, end.seen])

    here, steps = np.array([0.08, 0.3, 1423.0, 0.0795]), np.array([1e-6, 1e-4, 0.1, 1e-6])
    jacobian = np.column_stack([(flow(here + d) - flow(here - d)) / (2 * d.sum()) for d in np.diag(steps)])
    moved, stopped = advanced(before, own, sensor, line, 17.0, 0.0, 0.0)
    expected = jacobian @ prior @ jacobian.T
    spread = np.array([getattr(moved.covariance, name) for name in names])

    assert not stopped
    assert spread == pytest.approx(expected[np.triu_indices(4)], rel=1e-3)

    gain = prior[:, 3] / (prior[3, 3] + 4e-8)
    corrected = before.corrected(0.0797, 4e-8, 1.0)
    left = prior - np.outer(gain, prior[3])

    assert corrected.x == pytest.approx(0.08 + gain[0] * 2e-4)
    assert corrected.v == pytest.approx(0.3 + gain[1] * 2e-4)
    found = [getattr(corrected.covariance, name) for name in names]
    assert found == pytest.approx(list(left[np.triu_indices(4)]), rel=1e-9)
