"""The motion of a valve under commanded currents: another integrator, closed forms, and steps that do not show."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from euler_valve import EulerValve

from positioner.values import replace
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters
from positioner.valve.rollout import Moving, Numbers, Rollout, plant_of
from positioner.valve.state import StemState

PAPER = ValveParameters(id="paper")


def valve_of(fill_s: float, vent_s: float, damping: float | None = None) -> ValveParameters:
    """Return the paper's valve behind these lags; damping: ratio ζ of its stem."""
    critical = 2.0 * math.sqrt(PAPER.mass_kg * PAPER.spring_rate_n_per_m)
    viscous = PAPER.viscous_friction_n_s_per_m if damping is None else damping * critical
    lags = ActuatorParameters(fill_time_constant_s=fill_s, vent_time_constant_s=vent_s)
    return replace(PAPER, actuator=lags, viscous_friction_n_s_per_m=viscous)


def numbers_of(valve: ValveParameters) -> Numbers:
    gain = valve.force_gain_n_per_ma
    forces = (valve.spring_rate_n_per_m, valve.bench_set_n, valve.coulomb_friction_n, valve.static_friction_n)
    return Numbers(*(force / gain for force in forces))


def at_rest(rollout: Rollout, position_m: float, pressure_ma: float, direction: float = 1.0) -> Moving:
    return Moving(rollout.pressure.at_rest(pressure_ma), StemState(position_m, 0.0, True, direction))


def ended(rollout: Rollout, moving: Moving, current_ma: float, samples: int) -> Moving:
    for _ in range(samples):
        moving = rollout.after(moving, current_ma)
    return moving


@pytest.mark.parametrize("lags_s", [(0.003, 0.003), (0.02, 0.02), (0.1, 0.06)])
@pytest.mark.parametrize("period_s", [1e-3, 5e-3])
@pytest.mark.parametrize("damping", [None, 0.4])
@pytest.mark.parametrize("currents_ma", [(18.5, 12.0, 4.5), (5.0, 14.0, 20.0)])
def test_a_stem_goes_the_way_of_an_independent_integrator(
    lags_s: tuple[float, float], period_s: float, damping: float | None, currents_ma: tuple[float, ...]
) -> None:
    valve = valve_of(*lags_s, damping)
    numbers = numbers_of(valve)
    rollout, begun_ma = plant_of(valve, period_s, 0.0).rollout(numbers), numbers.spring_ma_per_m * 0.07
    moving, euler = at_rest(rollout, 0.07, begun_ma), EulerValve(valve, 0.07, begun_ma, period_s=period_s)
    farthest_m, apart_m = 0.0, 0.0
    for current_ma in currents_ma:
        for _ in range(round(0.15 / period_s)):
            moving = rollout.after(moving, current_ma)
            euler.sample(current_ma)
            apart_m = max(apart_m, abs(moving.stem.position_m - euler.x))
            farthest_m = max(farthest_m, abs(euler.x - 0.07))
    assert moving.pressure.pressure_ma == pytest.approx(euler.p, abs=2e-3)
    assert farthest_m > 0.009
    assert apart_m < 4e-4
    assert abs(moving.stem.position_m - euler.x) < 2e-4


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_stem_is_freed_by_more_than_its_static_friction_alone(direction: float) -> None:
    rollout = plant_of(valve_of(0.02, 0.02), 1e-3, 0.0).rollout(numbers_of(PAPER))
    numbers, start_ma = numbers_of(PAPER), numbers_of(PAPER).spring_ma_per_m * 0.07
    held = ended(rollout, at_rest(rollout, 0.07, start_ma), start_ma + 0.999 * direction * numbers.static_ma, 500)
    assert held.stem == StemState(0.07, 0.0, True, 1.0)
    freed = ended(rollout, at_rest(rollout, 0.07, start_ma), start_ma + 1.001 * direction * numbers.static_ma, 500)
    assert direction * (freed.stem.position_m - 0.07) > 0.9 * (numbers.static_ma - numbers.sliding_ma) / 0.1575 * 1e-3


def test_behind_a_slow_pressure_a_stem_stops_at_the_balance_of_its_level() -> None:
    numbers = numbers_of(PAPER)
    rollout = plant_of(valve_of(0.1, 0.1), 1e-3, 0.0).rollout(numbers)
    stopped = ended(rollout, at_rest(rollout, 0.06, numbers.spring_ma_per_m * 0.06), 18.0, 1500)
    balance_m = (18.0 - numbers.offset_ma - numbers.sliding_ma) / numbers.spring_ma_per_m
    assert stopped.stem.position_m == pytest.approx(balance_m, abs=5e-5)


def test_without_viscous_friction_a_stem_slips_twice_the_slip_jump_and_loses_no_energy_but_to_friction() -> None:
    valve = replace(PAPER, viscous_friction_n_s_per_m=1e-3)
    numbers = numbers_of(valve)
    rollout = plant_of(valve, 1e-3, 0.0).rollout(numbers)
    pressure_ma = numbers.spring_ma_per_m * 0.07 + numbers.static_ma + 1e-6
    moving = at_rest(rollout, 0.07, pressure_ma)
    stopped = ended(rollout, moving, pressure_ma, 60)
    assert stopped.stem.stuck
    jump_m = (numbers.static_ma - numbers.sliding_ma) / numbers.spring_ma_per_m
    assert stopped.stem.position_m - 0.07 == pytest.approx(2.0 * jump_m, rel=2e-3)
    x, v = (half := ended(rollout, moving, pressure_ma, 12)).stem.position_m, half.stem.velocity_m_per_s
    work = (pressure_ma - numbers.sliding_ma) * (x - 0.07) - 0.5 * numbers.spring_ma_per_m * (x * x - 0.07 * 0.07)
    kinetic = 0.5 * valve.mass_kg / valve.force_gain_n_per_ma * v * v
    assert kinetic == pytest.approx(work, rel=5e-3)


@pytest.mark.parametrize("lag_s", [0.005, 0.05])
def test_up_and_down_are_mirror_images(lag_s: float) -> None:
    numbers = numbers_of(PAPER)
    rollout = plant_of(valve_of(lag_s, lag_s), 1e-3, 0.0).rollout(replace(numbers, offset_ma=12.0))
    up, down = at_rest(rollout, 0.0, 12.0), at_rest(rollout, 0.0, 12.0, -1.0)
    for sample in range(300):
        step_ma = 6.0 if sample < 150 else -2.0
        up, down = rollout.after(up, 12.0 + step_ma), rollout.after(down, 12.0 - step_ma)
        assert down.stem.position_m == pytest.approx(-up.stem.position_m, abs=1e-12)
    assert abs(up.stem.position_m) > 0.005


def test_a_push_acts_as_a_change_of_the_offset() -> None:
    plant, numbers = plant_of(valve_of(0.02, 0.02), 1e-3, 0.0), numbers_of(PAPER)
    pushed, other = plant.rollout(numbers), plant.rollout(replace(numbers, offset_ma=numbers.offset_ma - 0.4))
    start = at_rest(pushed, 0.07, numbers.spring_ma_per_m * 0.07)
    a = ended(pushed, replace(start, shift_ma=0.4), 17.5, 200)
    b = ended(other, start, 17.5, 200)
    assert a.stem.position_m == pytest.approx(b.stem.position_m, abs=1e-9)
    assert b.stem.position_m > ended(pushed, start, 17.5, 200).stem.position_m + 0.002


def test_a_stop_has_no_jumps_of_a_step() -> None:
    plant, numbers = plant_of(valve_of(0.1, 0.1), 1e-3, 0.0), numbers_of(PAPER)
    rollout = plant.rollout(numbers)
    stops_m = []
    for part in range(40):  # the pressure begins a little higher: the stem is freed at another phase of the step
        moving = at_rest(rollout, 0.07, numbers.spring_ma_per_m * 0.07 + 1.3 + 0.0125 * part)
        for current_ma in [20.0] * 70 + [4.0] * 30:
            moving = rollout.after(moving, current_ma)
        stops_m.append(ended(rollout, moving, 12.0, 300).stem.position_m)
    steps_m = [after - before for before, after in pairwise(stops_m)]
    assert stops_m[-1] - stops_m[0] > 1e-3
    assert max(abs(b - a) for a, b in pairwise(steps_m)) < 5e-6


def test_a_dead_time_delays_a_motion_by_itself() -> None:
    valve, numbers = valve_of(0.02, 0.02), numbers_of(PAPER)
    rollouts = [plant_of(valve, 1e-3, delay_s).rollout(numbers) for delay_s in (0.0, 0.007)]
    moving = [at_rest(rollout, 0.07, numbers.spring_ma_per_m * 0.07) for rollout in rollouts]
    ways: list[list[float]] = [[], []]
    for _ in range(150):
        for place, rollout in enumerate(rollouts):
            moving[place] = rollout.after(moving[place], 17.0)
            ways[place].append(moving[place].stem.position_m)
    assert ways[1][7:] == pytest.approx(ways[0][:-7], abs=1e-12)
    assert ways[0][-1] > 0.075


@pytest.mark.parametrize("times", [0.7, 1.6])
def test_a_longer_lag_is_that_of_another_configuration(times: float) -> None:
    numbers = numbers_of(PAPER)
    scaled = plant_of(valve_of(0.05, 0.03), 1e-3, 0.0).rollout(replace(numbers, lag=times))
    other = plant_of(valve_of(0.05 * times, 0.03 * times), 1e-3, 0.0).rollout(numbers)
    ends = [ended(one, at_rest(one, 0.07, numbers.spring_ma_per_m * 0.07), 17.0, 90) for one in (scaled, other)]
    assert ends[0].pressure.pressure_ma == pytest.approx(ends[1].pressure.pressure_ma, abs=1e-9)
    assert ends[0].stem.position_m == pytest.approx(ends[1].stem.position_m, abs=1e-9)
