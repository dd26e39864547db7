"""The iterative controller: its programme against eqs 17, 29 and 30 written out, its plan against other solvers."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from dense import dense
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import LinearConstraint, linprog, minimize

from positioner.laws.bounds import Bounds
from positioner.laws.paper.planner import PlannerSettings, condense, free_response, plan, program
from positioner.optimization.solver import QpSolver
from positioner.valve.parameters import ValveParameters

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.optimization.qp import QuadraticProgram

VALVE = ValveParameters(id="paper")
FREE = Bounds(-10.0, 10.0, 4.0, 20.0)
PAPER = PlannerSettings()
HELD = PlannerSettings(prediction_steps=9, control_steps=3, terminal_factor=3.0)
SLOW_S, FAST_S = 1e-3, 1e-4

starts = st.tuples(st.floats(0.03, 0.11), st.floats(-0.8, 0.8))
setpoints_m = st.floats(0.06, 0.095)


def solver_for(tuning: PlannerSettings) -> QpSolver:
    return QpSolver(tuning.control_steps, tuning.prediction_steps, max_iterations=4000)


def simulated(
    tuning: PlannerSettings, valve: ValveParameters, start: tuple[float, float], inputs: np.ndarray, period_s: float
) -> np.ndarray:
    """Return the states (H_p, 2) of eqs 29 and 30, step by step, with Table 3's letters."""
    m, K_m, F_v = valve.mass_kg, valve.spring_rate_n_per_m, valve.viscous_friction_n_s_per_m  # noqa: N806 - Table 3
    x, v = start
    states = []
    for i in range(tuning.prediction_steps):
        u = inputs[min(i, len(inputs) - 1)]
        gamma = valve.coulomb_friction_n + (valve.static_friction_n - valve.coulomb_friction_n) * np.exp(
            -((v / valve.stribeck_velocity_m_per_s) ** 2)
        )
        friction = gamma * (np.sign(v) if abs(v) > tuning.sign_dead_zone_m_per_s else 0.0)
        pressure = valve.diaphragm_area_m2 * valve.pressure_gain_pa_per_ma * u
        push = pressure - K_m * x - valve.bench_set_n - F_v * v - friction
        x, v = x + period_s * v, v + period_s / m * push
        states.append((x, v))
    return np.array(states)


def forced_by_simulation(tuning: PlannerSettings, period_s: float) -> np.ndarray:
    """Return the states (H_p, 2, H_u) per mA of each input."""
    frictionless = replace(VALVE, static_friction_n=0.0, coulomb_friction_n=0.0)
    units = np.eye(tuning.control_steps)
    return np.stack([simulated(tuning, frictionless, (0.0, 0.0), unit, period_s) for unit in units], axis=2)


def cost(tuning: PlannerSettings, states: np.ndarray, inputs: np.ndarray, setpoint_m: float) -> float:
    """Return the cost of eq. 17 in cm and mA (D4 of DESIGN.md)."""
    weight = np.ones(len(states)) * tuning.error_weight_per_cm2
    weight[-1] *= tuning.terminal_factor
    error_cm = 100.0 * (setpoint_m - states[:, 0])
    return float(weight @ error_cm**2 + tuning.input_weight_per_ma2 * inputs @ inputs)


@settings(max_examples=60)
@given(
    st.sampled_from([PAPER, HELD, replace(PAPER, sign_dead_zone_m_per_s=0.1)]),
    starts,
    st.lists(st.floats(4.0, 20.0), min_size=4, max_size=4),
    st.sampled_from([SLOW_S, FAST_S]),
)
def test_the_states_are_those_of_the_papers_model(
    tuning: PlannerSettings, start: tuple[float, float], currents_ma: list[float], period_s: float
) -> None:
    inputs = np.array(currents_ma[: tuning.control_steps])
    for valve in (VALVE, replace(VALVE, bench_set_n=500.0)):
        forced = forced_by_simulation(tuning, period_s)
        states = free_response(tuning, valve, start, inputs, period_s) + forced @ inputs
        np.testing.assert_allclose(states, simulated(tuning, valve, start, inputs, period_s), rtol=1e-9, atol=1e-11)


@settings(max_examples=30)
@given(st.sampled_from([PAPER, HELD]), starts, setpoints_m, st.sampled_from([SLOW_S, FAST_S]))
def test_the_programme_costs_what_equation_17_costs(
    tuning: PlannerSettings, start: tuple[float, float], setpoint_m: float, period_s: float
) -> None:
    fixed = condense(tuning, VALVE, period_s)
    inputs = np.linspace(8.0, 16.0, tuning.control_steps)
    free = free_response(tuning, VALVE, start, inputs, period_s)
    made = dense(program(fixed, free, setpoint_m, FREE))
    forced = forced_by_simulation(tuning, period_s)

    def both(z: np.ndarray) -> tuple[float, float]:
        condensed = 0.5 * z @ made.P @ z + made.q @ z
        return condensed, cost(tuning, free + forced @ z, z, setpoint_m) / (2.0 * tuning.input_weight_per_ma2)

    (one, one_cost), (other, other_cost) = both(inputs), both(inputs[::-1] + 1.0)
    assert one - other == pytest.approx(one_cost - other_cost, rel=1e-7, abs=1e-9 * one_cost)


one_sided_bounds = st.builds(
    lambda limit, opening, bottom, width: Bounds(
        -10.0 if opening else -limit, limit if opening else 10.0, bottom, min(bottom + width, 20.5)
    ),
    st.floats(0.0, 10.0),
    st.booleans(),
    st.floats(3.8, 20.0),
    st.floats(0.01, 16.0),
)
"""The bounds that eqs 23 to 26 can give: the speed bound moves on one side only."""


@settings(max_examples=200)
@given(
    st.sampled_from([PAPER, HELD]),
    st.tuples(st.floats(-0.01, 0.14), st.floats(-3.0, 3.0)),
    one_sided_bounds,
    st.sampled_from([SLOW_S, FAST_S]),
)
def test_a_relaxed_speed_bound_always_leaves_a_feasible_programme(
    tuning: PlannerSettings, start: tuple[float, float], bounds: Bounds, period_s: float
) -> None:
    inputs = np.full(tuning.control_steps, bounds.current_low_ma)
    free = free_response(tuning, VALVE, start, inputs, period_s)
    made = dense(program(condense(tuning, VALVE, period_s), free, 0.08, bounds))
    assert np.all(made.l <= made.u)
    # phase one of an independent solver: the least violation s of l - s <= Az <= u + s
    slack = np.full((len(made.A), 1), -1.0)
    found = linprog(
        np.append(np.zeros(tuning.control_steps), 1.0),
        A_ub=np.vstack([np.hstack([made.A, slack]), np.hstack([-made.A, slack])]),
        b_ub=np.concatenate([made.u, -made.l]),
        bounds=[(None, None)] * tuning.control_steps + [(0.0, None)],
    )
    assert found.status == 0
    assert found.fun == pytest.approx(0.0, abs=1e-7)


def test_a_bound_that_full_braking_can_keep_is_not_relaxed() -> None:
    fixed = condense(PAPER, VALVE, SLOW_S)
    free = free_response(PAPER, VALVE, (0.07, 0.1), np.full(4, 12.0), SLOW_S)
    bounds = Bounds(-0.5, 0.4, 4.0, 20.0)
    made = dense(program(fixed, free, 0.08, bounds))
    speeds = free[:, 1] + forced_by_simulation(PAPER, SLOW_S)[:, 1, :] @ np.full(4, 11.0)
    rows = made.A[4:] @ np.full(4, 11.0)
    np.testing.assert_allclose((made.u[4:] - rows) / fixed.speed_unit, 0.4 - speeds, atol=1e-12)
    np.testing.assert_allclose((made.l[4:] - rows) / fixed.speed_unit, -0.5 - speeds, atol=1e-12)


def test_a_bound_inside_the_present_speed_asks_for_full_braking() -> None:
    found = plan(
        PAPER, VALVE, solver_for(PAPER), (0.07, 2.0), 0.09, Bounds(-10.0, 0.01, 4.0, 20.0), np.full(4, 12.0), FAST_S
    )
    assert found is not None
    assert found.inputs_ma == pytest.approx(np.full(4, 4.0), abs=0.02)


@settings(max_examples=60)
@given(
    st.sampled_from([(PAPER, SLOW_S), (PAPER, FAST_S), (HELD, SLOW_S)]),
    starts,
    setpoints_m,
    st.sampled_from([FREE, Bounds(-10.0, 0.35, 4.0, 20.0), Bounds(-0.2, 10.0, 4.0, 20.0), Bounds(-10, 10, 16.0, 20.0)]),
)
def test_a_converged_plan_obeys_its_bounds_and_is_a_fixed_point(
    case: tuple[PlannerSettings, float], start: tuple[float, float], setpoint_m: float, bounds: Bounds
) -> None:
    tuning, period_s = case
    solver = solver_for(tuning)
    guess = np.clip(np.full(tuning.control_steps, 12.0), bounds.current_low_ma, bounds.current_high_ma)
    found = plan(tuning, VALVE, solver, start, setpoint_m, bounds, guess, period_s)
    assert found is not None
    assert np.all((found.inputs_ma >= bounds.current_low_ma) & (found.inputs_ma <= bounds.current_high_ma))
    assert 1 <= found.passes <= tuning.max_passes
    if found.passes == tuning.max_passes:  # it may not have converged
        return
    made = dense(
        program(
            condense(tuning, VALVE, period_s),
            free_response(tuning, VALVE, start, found.inputs_ma, period_s),
            setpoint_m,
            bounds,
        )
    )
    rows = made.A @ found.inputs_ma
    assert np.all(rows >= made.l - 0.02)
    assert np.all(rows <= made.u + 0.02)
    # "the values predicted by the linear model coincide with the ones predicted by the original" (paper 4.1)
    expected = simulated(tuning, VALVE, start, found.inputs_ma, period_s)
    linear = (
        free_response(tuning, VALVE, start, found.inputs_ma, period_s)
        + forced_by_simulation(tuning, period_s) @ found.inputs_ma
    )
    np.testing.assert_allclose(linear[:, 0], expected[:, 0], atol=2e-6)
    again = plan(tuning, VALVE, solver, start, setpoint_m, bounds, found.inputs_ma, period_s)
    assert again is not None
    assert again.passes < tuning.max_passes
    assert again.inputs_ma == pytest.approx(found.inputs_ma, abs=0.02)


@pytest.mark.parametrize("period_s", [SLOW_S, FAST_S])
@pytest.mark.parametrize("tuning", [PAPER, HELD])
@pytest.mark.parametrize(
    ("start", "setpoint_m", "bounds"),
    [
        ((0.060, 0.30), 0.080, FREE),
        ((0.060, 0.30), 0.0605, FREE),
        ((0.090, -0.40), 0.0885, FREE),
        ((0.060, 0.30), 0.080, Bounds(-10.0, 0.32, 4.0, 20.0)),
        ((0.090, -0.30), 0.080, Bounds(-0.35, 10.0, 4.0, 20.0)),
        ((0.060, 0.30), 0.080, Bounds(-10.0, 10.0, 4.0, 14.0)),
    ],
)
def test_a_plan_is_what_an_independent_solver_makes_of_the_same_programme(
    period_s: float, tuning: PlannerSettings, start: tuple[float, float], setpoint_m: float, bounds: Bounds
) -> None:
    # trust-constr on eq. 17, put together from simulations: no condensing, no OSQP; the friction is that along the plan
    count = tuning.control_steps
    found = plan(tuning, VALVE, solver_for(tuning), start, setpoint_m, bounds, np.full(count, 12.0), period_s)
    assert found is not None
    assert found.passes < tuning.max_passes
    forced = forced_by_simulation(tuning, period_s)
    free = simulated(tuning, VALVE, start, found.inputs_ma, period_s) - forced @ found.inputs_ma
    weight = np.ones(tuning.prediction_steps)
    weight[-1] = tuning.terminal_factor
    root = np.vstack([100.0 * np.sqrt(weight)[:, None] * forced[:, 0], np.sqrt(1e-5) * np.eye(count)])
    target = np.concatenate([100.0 * np.sqrt(weight) * (setpoint_m - free[:, 0]), np.zeros(count)])

    def states(inputs: np.ndarray) -> np.ndarray:
        return np.asarray(free + forced @ inputs)

    def objective(inputs: np.ndarray) -> float:
        return 1e5 * cost(tuning, states(inputs), inputs, setpoint_m)

    # D10 of DESIGN.md: never tighter than the ends of the loop current can reach
    high = np.maximum(bounds.speed_high_m_per_s, states(np.full(count, bounds.current_low_ma))[:, 1])
    low = np.minimum(bounds.speed_low_m_per_s, states(np.full(count, bounds.current_high_ma))[:, 1])
    other = minimize(
        objective,
        np.full(count, 0.5 * (bounds.current_low_ma + bounds.current_high_ma)),
        jac=lambda inputs: 2e5 * root.T @ (root @ inputs - target),
        hess=lambda _inputs: 2e5 * root.T @ root,
        method="trust-constr",
        constraints=[
            LinearConstraint(np.eye(count), bounds.current_low_ma, bounds.current_high_ma),
            LinearConstraint(forced[:, 1], low - free[:, 1], high - free[:, 1]),
        ],
        options={"maxiter": 2000, "gtol": 1e-8, "xtol": 1e-10},
    )
    assert objective(found.inputs_ma) == pytest.approx(objective(other.x), rel=1e-3)
    assert found.inputs_ma[:-1] == pytest.approx(other.x[:-1], abs=0.1)
    assert float(found.inputs_ma[0]) == pytest.approx(float(other.x[0]), abs=0.02)


class ScriptedSolver:
    """A solver that returns the given currents, one after the other, and then no solution."""

    def __init__(self, answers_ma: list[float]) -> None:
        self.answers_ma = iter(answers_ma)

    def solve(
        self,
        program: QuadraticProgram,
        inputs: Sequence[float] | None = None,
        multipliers: Sequence[float] | None = None,
    ) -> list[float] | None:
        del inputs, multipliers
        answer = next(self.answers_ma, None)
        return None if answer is None else [answer] * len(program.q)


@pytest.mark.parametrize("answers_ma", [[], [10.0, 11.0]])
def test_no_solution_on_the_way_is_no_plan(answers_ma: list[float]) -> None:
    solver = ScriptedSolver(answers_ma)
    assert plan(PAPER, VALVE, solver, (0.08, 0.0), 0.085, FREE, np.full(4, 12.0), FAST_S) is None


def test_passes_that_do_not_converge_end_with_the_last_one() -> None:
    solver = ScriptedSolver([10.0, 11.0] * 4 + [9.0])
    found = plan(PAPER, VALVE, solver, (0.08, 0.0), 0.085, FREE, np.full(4, 12.0), FAST_S)
    assert found is not None
    assert (found.passes, found.inputs_ma.tolist()) == (8, [11.0] * 4)


def test_passes_end_when_a_solution_repeats() -> None:
    found = plan(PAPER, VALVE, ScriptedSolver([10.0, 10.0005]), (0.08, 0.0), 0.085, FREE, np.full(4, 12.0), FAST_S)
    assert found is not None
    assert (found.passes, found.inputs_ma.tolist()) == (2, [10.0005] * 4)


def test_what_a_solver_leaves_outside_the_loop_is_cut_off() -> None:
    found = plan(PAPER, VALVE, ScriptedSolver([20.01, 20.02]), (0.08, 0.0), 0.085, FREE, np.full(4, 12.0), FAST_S)
    assert found is not None
    assert found.inputs_ma.tolist() == [20.0] * 4


def test_a_control_horizon_beyond_the_prediction_is_refused() -> None:
    PlannerSettings(prediction_steps=4, control_steps=4)
    with pytest.raises(ValueError, match="control_steps"):
        PlannerSettings(prediction_steps=4, control_steps=5)


@pytest.mark.parametrize(("v", "sign"), [(0.2, 1.0), (-0.2, -1.0), (0.1, 0.0), (-0.1, 0.0), (0.0, 0.0)])
def test_coulomb_friction_has_the_sign_of_the_speed_outside_the_dead_zone(v: float, sign: float) -> None:
    tuning = replace(PAPER, sign_dead_zone_m_per_s=0.1)
    free = free_response(tuning, VALVE, (0.0, v), np.full(4, 12.0), FAST_S)
    rate = FAST_S / VALVE.mass_kg
    expected = v - rate * (VALVE.viscous_friction_n_s_per_m * v + sign * VALVE.kinetic_friction_n(v))
    assert free[0].tolist() == [pytest.approx(FAST_S * v), pytest.approx(expected)]
