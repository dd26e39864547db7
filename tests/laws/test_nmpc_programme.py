"""The programme that places a stop: its minimiser, its bounds, and where a stem stops under its currents."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from dense import dense
from euler_valve import EulerValve
from scipy.optimize import LinearConstraint, minimize

from positioner.laws.nmpc.belief import belief_of
from positioner.laws.nmpc.move import Limits
from positioner.laws.nmpc.programme import KNOTS, NEAR, Line, StopPlanner, programme
from positioner.laws.nmpc.slip import numbers_of, task_of
from positioner.laws.nmpc.stop import Task, limited, stop_of
from positioner.optimization.solver import QpSolver
from positioner.values import replace
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters
from positioner.valve.rollout import Moving, Rollout, plant_of
from positioner.valve.state import StemState

SPAN_M = ValveParameters(id="paper").span_m
LIMITS = Limits(4.0, 20.0, 0.0, 0.1397)
WEIGHT = 1e3


def valve_of(lag_s: float, **others: float) -> ValveParameters:
    return ValveParameters(
        id="paper", actuator=ActuatorParameters(fill_time_constant_s=lag_s, vent_time_constant_s=lag_s, **others)
    )


def begun(
    valve: ValveParameters, period_s: float, way_m: float, step_ma: float = math.inf
) -> tuple[Rollout, Task, Moving]:
    """Return a move of so far whose stem has just begun to slide, and where it is then."""
    belief, plant = belief_of(valve), plant_of(valve, period_s, 0.0)
    rollout, rests_ma = plant.rollout(numbers_of(belief.numbers.mean)), belief.balance_ma(0.07)
    pressure = rollout.pressure.at_rest(rests_ma)
    task = task_of(belief, valve.actuator, LIMITS, pressure, 0.07, 0.07 + way_m, period_s, rests_ma, step_ma)
    assert task is not None
    moving = Moving(pressure, StemState(0.07, 0.0, True, task.direction))
    while moving.stem.stuck:
        current_ma = limited(task, (task.boost_ma,), 1)[0]
        task, moving = replace(task, before_ma=current_ma), rollout.after(moving, current_ma)
    return rollout, replace(task, pressure=moving.pressure), moving


def planner_within(limits: Limits = LIMITS) -> StopPlanner:
    return StopPlanner(QpSolver(KNOTS, KNOTS), limits, NEAR * SPAN_M)


def line_of(seed: int, *, step_ma: float) -> tuple[Line, Task, list[float], float]:
    """Return currents within the limits and the rate, and slopes and an error, at random."""
    chance = np.random.default_rng(seed)
    _, task, _ = begun(valve_of(0.02), 1e-3, 0.014)
    task = replace(task, step_ma=step_ma, before_ma=float(chance.uniform(4.0, 20.0)))
    end = int(chance.integers(3, 40))
    planned = limited(task, tuple(chance.uniform(4.0, 20.0, end).tolist()), end)
    line = Line.until(end, planned)
    slopes = chance.uniform(0.0, 1.0, len(line.knots))
    return line, task, (slopes / slopes.max()).tolist(), float(chance.normal(0.0, 5.0))


@pytest.mark.parametrize("seed", range(12))
def test_far_from_its_bounds_the_programme_shares_the_error_among_the_knots_by_their_slopes(seed: int) -> None:
    line, task, slopes, error_ma = line_of(seed, step_ma=math.inf)
    wide = replace(LIMITS, low_ma=-1e3, high_ma=1e3)
    found = QpSolver(KNOTS, KNOTS, tolerance=1e-9, max_iterations=100_000).solve(
        programme(line, task, wide, slopes, error_ma)
    )
    assert found is not None
    g = np.array(slopes + [0.0] * (KNOTS - len(slopes)))
    assert found == pytest.approx((-WEIGHT * error_ma * g / (1.0 + WEIGHT * g @ g)).tolist(), abs=1e-4)


@pytest.mark.parametrize("seed", range(12))
def test_the_programme_is_the_least_change_within_the_limits_and_the_rate(seed: int) -> None:
    """Against another solver, on the problem as it is written: limits at the knots, and the rate at every sample."""
    line, task, slopes, error_ma = line_of(seed, step_ma=1.5)
    program, count = programme(line, task, LIMITS, slopes, error_ma), len(line.knots)
    found = QpSolver(KNOTS, KNOTS, tolerance=1e-9, max_iterations=100_000).solve(program)
    assert found is not None
    assert found[count:] == pytest.approx([0.0] * (KNOTS - count), abs=1e-6)

    hats = np.array([np.array(line.changed(row)) - np.array(line.planned) for row in np.eye(count).tolist()]).T
    last = line.knots[-1] + 1
    steps = np.diff(np.vstack([np.zeros(count), hats[:last]]), axis=0)
    planned_steps = np.diff([task.before_ma, *line.planned[:last]])
    bounds = [(4.0 - line.planned[knot], 20.0 - line.planned[knot]) for knot in line.knots]
    rate = LinearConstraint(steps, -1.5 - planned_steps, 1.5 - planned_steps)
    g = np.array(slopes)

    def cost(change: np.ndarray) -> float:
        return float(change @ change / WEIGHT + (error_ma + g @ change) ** 2)

    expected = minimize(
        cost, np.zeros(count), bounds=bounds, constraints=rate, method="SLSQP", options={"ftol": 1e-12, "maxiter": 1000}
    )
    assert expected.success
    assert cost(np.array(found[:count])) == pytest.approx(expected.fun, rel=1e-3, abs=1e-6)
    full = dense(program)
    assert full.A[:KNOTS].tolist() == np.eye(KNOTS).tolist()


def test_changes_go_in_straight_lines_from_knot_to_knot_and_to_zero_at_the_end() -> None:
    line = Line.until(16, (10.0,) * 20)
    assert line.knots == (0, 2, 4, 6, 8, 10, 12, 14)
    changed = line.changed([0.0, 2.0, 2.0, 0.0, 0.0, 0.0, 0.0, -1.0])
    assert changed == (10.0, 11.0, 12.0, 12.0, 12.0, 11.0, *[10.0] * 7, 9.5, 9.0, 9.5, *[10.0] * 4)
    assert Line.until(3, (10.0,) * 3).knots == (0, 1, 2)


@pytest.mark.parametrize("period_s", [1e-3, 5e-3, 2e-2])
@pytest.mark.parametrize(
    "valve",
    [
        valve_of(0.005),
        valve_of(0.02, dead_time_s=0.004),
        valve_of(0.02, converter_time_constant_s=0.01),
        valve_of(0.05, slew_ma_per_s=120.0),
        valve_of(0.1),
    ],
    ids=["5 ms", "dead time", "I/P", "slew", "100 ms"],
)
@pytest.mark.parametrize("way_m", [0.02, -0.012])
def test_a_stop_that_currents_can_reach_is_placed_at_its_target(
    period_s: float, valve: ValveParameters, way_m: float
) -> None:
    rollout, task, moving = begun(valve, period_s, way_m)
    braked_m, boosted_m = (
        stop_of(rollout, task, task.currents(boost_s), moving).position_m for boost_s in (0.0, period_s)
    )
    # a target between the stops of a brake that comes now and of one that comes a sample later
    task = replace(task, target_m=0.6 * braked_m + 0.4 * boosted_m)
    currents, stop, solved = planner_within().placed(rollout, task, moving, task.currents(0.4 * period_s))
    near = abs(stop_of(rollout, task, task.currents(0.4 * period_s), moving).position_m - task.target_m) < NEAR * SPAN_M
    assert solved == (not near)
    assert abs(boosted_m - braked_m) > NEAR * SPAN_M
    assert abs(stop.position_m - task.target_m) < NEAR * SPAN_M
    assert stop == stop_of(rollout, task, currents, moving)
    assert all(4.0 - 1e-9 < current_ma < 20.0 + 1e-9 for current_ma in currents)


def test_the_stem_of_another_integrator_stops_there_too() -> None:
    valve = valve_of(0.05)
    rollout, task, moving = begun(valve, 1e-3, 0.02)
    plant = EulerValve(valve, 0.07, belief_of(valve).balance_ma(0.07))
    while plant.stuck:
        plant.sample(20.0)
    for _ in range(6):
        plant.sample(20.0)
        moving = rollout.after(moving, 20.0)
    task = replace(task, pressure=moving.pressure)
    task = replace(task, target_m=stop_of(rollout, task, task.currents(0.0), moving).position_m + 0.001)
    currents, _, _ = planner_within().placed(rollout, task, moving, task.currents(0.0))
    assert plant.play(currents, task.hold_ma) == pytest.approx(task.target_m, abs=0.001 * SPAN_M)


@pytest.mark.parametrize("rate_ma_per_s", [100.0, 300.0, 1000.0])
@pytest.mark.parametrize("way_m", [0.03, -0.03])
def test_no_current_changes_faster_than_its_rate(rate_ma_per_s: float, way_m: float) -> None:
    step_ma = rate_ma_per_s * 1e-3
    rollout, task, moving = begun(valve_of(0.05), 1e-3, way_m, step_ma)
    braked = stop_of(rollout, task, task.currents(0.0), moving)
    task = replace(task, target_m=braked.position_m + task.direction * 0.0005)
    currents, stop, _ = planner_within().placed(rollout, task, moving, task.currents(0.0))
    assert abs(stop.position_m - task.target_m) < NEAR * SPAN_M
    assert stop.is_held
    changes = [after - before for before, after in pairwise((task.before_ma, *currents))]
    assert max(map(abs, changes)) <= step_ma * (1.0 + 1e-9)
    assert stop_of(rollout, replace(task, step_ma=math.inf), currents, moving).position_m == stop.position_m


def test_where_no_current_reaches_the_target_the_stop_is_the_nearest() -> None:
    rollout, task, moving = begun(valve_of(0.05), 1e-3, 0.02)
    braked = stop_of(rollout, task, task.currents(0.0), moving)
    task = replace(task, target_m=braked.position_m - 0.002)  # the brake cannot be stronger
    currents, stop, _ = planner_within().placed(rollout, task, moving, task.currents(0.0))
    assert braked.position_m - 1e-4 < stop.position_m <= braked.position_m
    assert min(currents) > 4.0 - 1e-9


class NoSolution:
    """A solver that finds nothing."""

    def solve(self, *_: object) -> None:
        """Return that there is no solution."""


def test_without_a_solution_the_planned_currents_stay() -> None:
    rollout, task, moving = begun(valve_of(0.05), 1e-3, 0.02)
    planned = task.currents(0.0)
    stop = stop_of(rollout, task, planned, moving)
    task = replace(task, target_m=stop.position_m + task.direction * 0.001)
    planner = StopPlanner(NoSolution(), LIMITS, NEAR * SPAN_M)
    assert planner.placed(rollout, task, moving, planned) == (planned, stop, 0)


def test_a_stop_that_is_near_its_target_needs_no_programme() -> None:
    rollout, task, moving = begun(valve_of(0.05), 1e-3, 0.02)
    planned = task.currents(0.0)
    stop = stop_of(rollout, task, planned, moving)
    task = replace(task, target_m=stop.position_m + 0.5 * NEAR * SPAN_M)
    assert planner_within().placed(rollout, task, moving, planned) == (planned, stop, 0)
