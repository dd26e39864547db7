"""The motion of a valve under commanded currents: another integrator, closed forms, and steps that do not show."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from euler_valve import EulerValve

from positioner.values import replace
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters
from positioner.valve.rollout import Moving, Numbers, Rollout, WithinStep, plant_of
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
    spring, offset, sliding, static = (force / gain for force in forces)
    return Numbers(spring, offset, sliding, static, valve.actuator.lag_s(fills=True), valve.actuator.dead_time_s)


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


@pytest.mark.parametrize("dead_time_s", [0.0, 0.0007, 0.004, 0.0123])
@pytest.mark.parametrize("period_s", [1e-3, 5e-3])
def test_the_places_under_runs_of_currents_are_those_of_the_motion_sample_by_sample(
    dead_time_s: float, period_s: float
) -> None:
    valve = valve_of(0.02, 0.015)
    valve = replace(valve, actuator=replace(valve.actuator, converter_time_constant_s=0.003, dead_time_s=dead_time_s))
    numbers = numbers_of(valve)
    rollout = plant_of(valve, period_s, 0.0).rollout(numbers)
    moving = replace(at_rest(rollout, 0.07, numbers.spring_ma_per_m * 0.07), shift_ma=0.1)
    runs = ((20.0, 40), (4.0, 25), (13.0, 30))

    found = rollout.places_m(moving, runs)

    currents = [current_ma for current_ma, count in runs for _ in range(count)]
    path = [each.stem.position_m for _, each in zip(currents, rollout.path(moving, currents), strict=False)]
    assert found == path
    assert 0.01 < max(found) - min(found) < 0.07


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_stem_is_freed_by_more_than_its_static_friction_alone(direction: float) -> None:
    valve, numbers = valve_of(0.02, 0.02), numbers_of(valve_of(0.02, 0.02))
    rollout, start_ma = plant_of(valve, 1e-3, 0.0).rollout(numbers), numbers.spring_ma_per_m * 0.07
    held = ended(rollout, at_rest(rollout, 0.07, start_ma), start_ma + 0.999 * direction * numbers.static_ma, 500)
    assert held.stem == StemState(0.07, 0.0, True, 1.0)
    freed = ended(rollout, at_rest(rollout, 0.07, start_ma), start_ma + 1.001 * direction * numbers.static_ma, 500)
    assert direction * (freed.stem.position_m - 0.07) > 0.9 * (numbers.static_ma - numbers.sliding_ma) / 0.1575 * 1e-3


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("offset_ma", [0.0, 1.5])
def test_behind_a_slow_pressure_a_stem_stops_at_the_balance_of_its_level(offset_ma: float, direction: float) -> None:
    numbers = replace(numbers_of(valve_of(0.1, 0.1)), offset_ma=offset_ma)
    rollout = plant_of(valve_of(0.1, 0.1), 1e-3, 0.0).rollout(numbers)
    begun_ma = numbers.spring_ma_per_m * 0.07 + offset_ma
    level_ma = begun_ma + direction * 7.0
    stopped = ended(rollout, at_rest(rollout, 0.07, begun_ma), level_ma, 1500)
    balance_m = (level_ma - offset_ma - direction * numbers.sliding_ma) / numbers.spring_ma_per_m
    assert abs(stopped.stem.velocity_m_per_s) < 1e-6  # it creeps behind an exponential, and so never quite stops
    assert stopped.stem.position_m == pytest.approx(balance_m, abs=1e-6)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_without_viscous_friction_a_stem_slips_twice_the_slip_jump_and_loses_no_energy_but_to_friction(
    direction: float,
) -> None:
    valve = replace(PAPER, viscous_friction_n_s_per_m=1e-3)
    numbers = numbers_of(valve)
    rollout = plant_of(valve, 1e-3, 0.0).rollout(numbers)
    pressure_ma = numbers.spring_ma_per_m * 0.07 + direction * (numbers.static_ma + 1e-6)
    moving = at_rest(rollout, 0.07, pressure_ma)
    stopped = ended(rollout, moving, pressure_ma, 60)
    assert stopped.stem.stuck
    jump_m = direction * (numbers.static_ma - numbers.sliding_ma) / numbers.spring_ma_per_m
    assert stopped.stem.position_m - 0.07 == pytest.approx(2.0 * jump_m, rel=2e-3)
    x, v = (half := ended(rollout, moving, pressure_ma, 12)).stem.position_m, half.stem.velocity_m_per_s
    push_ma = pressure_ma - direction * numbers.sliding_ma
    work = push_ma * (x - 0.07) - 0.5 * numbers.spring_ma_per_m * (x * x - 0.07 * 0.07)
    kinetic = 0.5 * valve.mass_kg / valve.force_gain_n_per_ma * v * v
    assert kinetic == pytest.approx(work, rel=5e-3)


@pytest.mark.parametrize("lag_s", [0.005, 0.05])
def test_up_and_down_are_mirror_images(lag_s: float) -> None:
    numbers = numbers_of(valve_of(lag_s, lag_s))
    rollout = plant_of(valve_of(lag_s, lag_s), 1e-3, 0.0).rollout(replace(numbers, offset_ma=12.0))
    up, down = at_rest(rollout, 0.0, 12.0), at_rest(rollout, 0.0, 12.0, -1.0)
    for sample in range(300):
        step_ma = 6.0 if sample < 150 else -2.0
        up, down = rollout.after(up, 12.0 + step_ma), rollout.after(down, 12.0 - step_ma)
        assert down.stem.position_m == pytest.approx(-up.stem.position_m, abs=1e-12)
    assert abs(up.stem.position_m) > 0.005


def test_a_push_acts_as_a_change_of_the_offset() -> None:
    plant, numbers = plant_of(valve_of(0.02, 0.02), 1e-3, 0.0), numbers_of(valve_of(0.02, 0.02))
    pushed, other = plant.rollout(numbers), plant.rollout(replace(numbers, offset_ma=numbers.offset_ma - 0.4))
    start = at_rest(pushed, 0.07, numbers.spring_ma_per_m * 0.07)
    a = ended(pushed, replace(start, shift_ma=0.4), 17.5, 200)
    b = ended(other, start, 17.5, 200)
    assert a.stem.position_m == pytest.approx(b.stem.position_m, abs=1e-9)
    assert b.stem.position_m > ended(pushed, start, 17.5, 200).stem.position_m + 0.002


def test_a_stop_has_no_jumps_of_a_step() -> None:
    plant, numbers = plant_of(valve_of(0.1, 0.1), 1e-3, 0.0), numbers_of(valve_of(0.1, 0.1))
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
    valve, numbers = valve_of(0.02, 0.02), numbers_of(valve_of(0.02, 0.02))
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
    numbers = replace(numbers_of(PAPER), lag_s=0.05 * times)
    scaled = plant_of(valve_of(0.05, 0.03), 1e-3, 0.0).rollout(numbers)
    other = plant_of(valve_of(0.05 * times, 0.03 * times), 1e-3, 0.0).rollout(numbers)
    ends = [ended(one, at_rest(one, 0.07, numbers.spring_ma_per_m * 0.07), 17.0, 90) for one in (scaled, other)]
    assert ends[0].pressure.pressure_ma == pytest.approx(ends[1].pressure.pressure_ma, abs=1e-9)
    assert ends[0].stem.position_m == pytest.approx(ends[1].stem.position_m, abs=1e-9)


def mean_is_late_s(lag_s: float) -> float:
    """Return how late half the sum of both ends of a step of 1 ms is, in place of the mean of an exponential."""
    steps_of_lag = 1e-3 / lag_s
    return 1e-3 * (1.0 / (1.0 - math.exp(-steps_of_lag)) - 1.0 / steps_of_lag - 0.5)


@pytest.mark.parametrize("lag_s", [0.001, 0.005, 0.02, 0.1])
@pytest.mark.parametrize("period_s", [1e-3, 2e-2])
@pytest.mark.parametrize("damping", [0.2, 1.15, 5.0])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_quick_and_slow_pressures_light_and_heavy_damping_are_followed_both_ways(
    lag_s: float, period_s: float, damping: float, direction: float
) -> None:
    valve = valve_of(lag_s, lag_s, damping)
    numbers = numbers_of(valve)
    rollout, begun_ma = plant_of(valve, period_s, 0.0).rollout(numbers), numbers.spring_ma_per_m * 0.07
    moving, euler = at_rest(rollout, 0.07, begun_ma), EulerValve(valve, 0.07, begun_ma, period_s=period_s)
    apart_m, fastest_m_per_s = 0.0, 0.0
    for sign in (direction, -direction):
        for _ in range(round(0.4 / period_s)):
            moving = rollout.after(moving, begun_ma + sign * 7.0)
            euler.sample(begun_ma + sign * 7.0)
            apart_m = max(apart_m, abs(moving.stem.position_m - euler.x))
            fastest_m_per_s = max(fastest_m_per_s, abs(euler.v), abs(moving.stem.velocity_m_per_s))
        assert sign * (moving.stem.position_m - 0.07) > 0.01
        # an underdamped stem carries what it was late on into its stop, another one does not
        assert abs(moving.stem.position_m - euler.x) < (1e-4 if damping < 1.0 else 2e-6)
    # four steps of Euler's method are allowed for; samples of 20 ms are too long to see how fast the stem is
    if period_s == 1e-3:
        assert apart_m < (mean_is_late_s(lag_s) + 4e-5) * fastest_m_per_s


@pytest.mark.parametrize("viscous", [0.5, 2.0])
@pytest.mark.parametrize("lag", [0.8, 1.5])
def test_factors_of_viscous_friction_and_lag_are_those_of_the_integrator(viscous: float, lag: float) -> None:
    valve, numbers = valve_of(0.02, 0.03), numbers_of(valve_of(0.02, 0.03))
    plant, begun_ma = plant_of(valve, 1e-3, 0.0), numbers.spring_ma_per_m * 0.07
    rollout, nominal = plant.rollout(replace(numbers, viscous=viscous, lag_s=0.02 * lag)), plant.rollout(numbers)
    euler = EulerValve(valve, 0.07, begun_ma)
    euler.viscous *= viscous
    euler.fill_s, euler.vent_s = euler.fill_s * lag, euler.vent_s * lag
    moving, other, other_m = at_rest(rollout, 0.07, begun_ma), at_rest(nominal, 0.07, begun_ma), 0.0
    for current_ma in [19.0] * 30 + [5.0] * 80:
        moving, other = rollout.after(moving, current_ma), nominal.after(other, current_ma)
        euler.sample(current_ma)
        assert moving.stem.position_m == pytest.approx(euler.x, abs=5e-5)
        other_m = max(other_m, abs(other.stem.position_m - euler.x))
    assert other_m > 5e-4  # the factors matter


@pytest.mark.parametrize("phase", [0.05, 0.3, 0.5, 0.8, 0.97])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_stem_that_is_freed_within_a_step_is_pushed_from_that_instant_on(phase: float, direction: float) -> None:
    # a ramp p = p_0 + r t frees it at t_0, and then m v = (f_s - f_c) (t - t_0) + r (t - t_0)²/2, with 100 kg, whose
    # spring and viscous friction take less than 1 % of that within a step
    ramp = ActuatorParameters(slew_ma_per_s=1000.0)
    valve = replace(PAPER, mass_kg=100.0, actuator=ramp)
    numbers = numbers_of(valve)
    rollout = plant_of(valve, 1e-3, 0.0).rollout(numbers)
    onset_ma = numbers.spring_ma_per_m * 0.07 + direction * numbers.static_ma
    freed = rollout.after(at_rest(rollout, 0.07, onset_ma - direction * phase, -direction), onset_ma + direction * 5.0)
    since_s = (1.0 - phase) * 1e-3
    impulse = (numbers.static_ma - numbers.sliding_ma) * since_s + 0.5 * 1000.0 * since_s * since_s
    expected_m_per_s = direction * impulse * valve.force_gain_n_per_ma / valve.mass_kg
    assert freed.stem.velocity_m_per_s == pytest.approx(expected_m_per_s, rel=0.01)
    assert not freed.stem.stuck
    assert freed.stem.direction == direction


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_slip_that_is_shorter_than_a_step_ends_in_it_and_the_stem_sticks(direction: float) -> None:
    # 10 g on a spring of 10⁶ N/m: half a swing takes π √(m/K) = 0.31 ms
    ramp = ActuatorParameters(slew_ma_per_s=2.0)
    valve = replace(PAPER, mass_kg=0.01, spring_rate_n_per_m=1e6, viscous_friction_n_s_per_m=0.1, actuator=ramp)
    numbers = numbers_of(valve)
    rollout = plant_of(valve, 1e-3, 0.0).rollout(numbers)
    onset_ma = numbers.spring_ma_per_m * 0.005 + direction * numbers.static_ma
    slipped = rollout.after(at_rest(rollout, 0.005, onset_ma - direction * 2e-4), onset_ma + direction * 5.0).stem
    jump_m = direction * (numbers.static_ma - numbers.sliding_ma) / numbers.spring_ma_per_m
    assert (slipped.velocity_m_per_s, slipped.stuck, slipped.direction) == (0.0, True, direction)
    assert slipped.position_m - 0.005 == pytest.approx(2.0 * jump_m, rel=5e-3)


@pytest.mark.parametrize(
    ("period_s", "delay_s"), [(5e-3, 0.01), (5e-3, 0.007), (2e-2, 0.013), (2e-2, 0.0134), (1e-3, 0.0025)]
)
def test_a_dead_time_is_waited_for_in_steps_and_not_in_samples(period_s: float, delay_s: float) -> None:
    rollout = plant_of(valve_of(0.05, 0.05), period_s, delay_s).rollout(numbers_of(valve_of(0.05, 0.05)))
    moving, is_whole = at_rest(rollout, 0.07, 11.0), abs(delay_s - round(delay_s, 3)) < 1e-9
    least_ma = 1e-9 if is_whole else 6.0 * (1e-3 / 0.05) ** 2 / 8.0  # a divided step of h is exact to (h/τ)²/8
    for sample in range(1, 9):
        moving = rollout.after(moving, 17.0)
        since_s = max(sample * period_s - delay_s, 0.0)
        expected_ma = 17.0 - 6.0 * math.exp(-since_s / 0.05)
        assert moving.pressure.pressure_ma == pytest.approx(expected_ma, abs=least_ma)


@pytest.mark.parametrize(("period_s", "steps"), [(5e-4, 1), (1e-3, 1), (2.5e-3, 3), (5e-3, 5), (2e-2, 20)])
def test_a_sample_has_the_fewest_steps_of_a_millisecond_at_most(period_s: float, steps: int) -> None:
    plant = plant_of(PAPER, period_s, 0.0)
    assert plant.steps == steps
    assert plant.step_s * steps == pytest.approx(period_s, rel=1e-12)


@pytest.mark.parametrize("lag_s", [0.0005, 0.002, 0.005, 0.1])
def test_the_mean_of_a_step_of_pressure_is_that_of_its_exponential(lag_s: float) -> None:
    valve = valve_of(lag_s, lag_s)
    rollout, parts = plant_of(valve, 1e-3, 0.0).rollout(numbers_of(valve)), 100_000
    left = [math.exp(-1e-3 * (part + 0.5) / parts / lag_s) for part in range(parts)]
    expected = (1.0 - sum(left) / parts) / (1.0 - math.exp(-1e-3 / lag_s))
    assert rollout.filling.part_of_mean == rollout.venting.part_of_mean == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("of", [{"converter_time_constant_s": 0.01}, {"slew_ma_per_s": 50.0}])
def test_the_mean_of_a_pressure_that_is_no_exponential_is_half_way(of: dict[str, float]) -> None:
    valve = valve_of(0.005, 0.005)
    valve = replace(valve, actuator=replace(valve.actuator, **of))
    rollout = plant_of(valve, 1e-3, 0.0).rollout(numbers_of(valve))
    assert rollout.filling == rollout.venting == WithinStep(1.0, 0.5)
    assert rollout.filling.rest_of(0.25) == (0.75, 0.5)


@pytest.mark.parametrize("lag_s", [0.0002, 0.001, 0.005])
@pytest.mark.parametrize("share", [0.05, 0.5, 0.95])
def test_the_rest_of_a_step_is_that_of_its_exponential(lag_s: float, share: float) -> None:
    valve, step_s = valve_of(lag_s, lag_s), 1e-3
    rollout = plant_of(valve, step_s, 0.0).rollout(numbers_of(valve))
    part, part_of_mean = rollout.filling.rest_of(share)
    end = 1.0 - math.exp(-step_s / lag_s)
    begin_s = -lag_s * math.log(1.0 - share * end)
    assert part == pytest.approx(1.0 - begin_s / step_s)
    times_s = begin_s + (step_s - begin_s) * (np.arange(20_000) + 0.5) / 20_000
    mean = float(np.mean((1.0 - np.exp(-times_s / lag_s)) / end))
    assert part_of_mean == pytest.approx((mean - share) / (1.0 - share), rel=1e-4)


def test_a_stem_that_a_short_lag_frees_goes_as_far_as_one_that_is_freed_at_once() -> None:
    """A hundredth of a step of lag moves the end of a sample by no more than the sample is shorter by that."""
    ends_m = []
    for lag_s in (0.0, 1e-5):
        valve = valve_of(lag_s, lag_s)
        numbers = numbers_of(valve)
        rollout = plant_of(valve, 1e-3, 0.0).rollout(numbers)
        begun_ma = numbers.balance_ma(0.07)
        ends_m.append(
            ended(rollout, at_rest(rollout, 0.07, begun_ma), begun_ma + 1.02 * numbers.static_ma, 1).stem.position_m
        )
    gone_m = ends_m[0] - 0.07
    assert gone_m > 1e-5
    assert 0.9 * gone_m < ends_m[1] - 0.07 < gone_m
