"""The quadratic programme solver: its answers against their optimality conditions, its refusals, its repeatability."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import osqp
import pytest
from dense import dense
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear, nnls

from positioner.optimization.qp import QuadraticProgram, packed
from positioner.optimization.solver import QpSolver

INPUTS, STEPS = 4, 6
TOLERANCE = 1e-3
"""OSQP ends at residuals of 1e-5, absolute and relative to terms of up to some tens here."""


def packed_program(
    P: np.ndarray,  # noqa: N803 - the literature's letters
    q: np.ndarray,
    outputs: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> QuadraticProgram:
    """Return the programme of numpy arrays; outputs (STEPS, INPUTS), low and high (INPUTS + STEPS,)."""
    triangle, columns = packed(P, outputs)
    return QuadraticProgram(triangle, q.tolist(), columns, low.tolist(), high.tolist())


def random_program(seed: int) -> QuadraticProgram:
    """Return a convex programme that has a solution: a random point is inside its constraints."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(INPUTS, INPUTS))
    outputs = np.tril(random.normal(size=(STEPS, INPUTS)))
    inside = np.vstack([np.eye(INPUTS), outputs]) @ random.normal(size=INPUTS)
    return packed_program(
        root.T @ root + np.eye(INPUTS),
        5.0 * random.normal(size=INPUTS),
        outputs,
        inside - random.uniform(0.0, 1.0, size=INPUTS + STEPS),
        inside + random.uniform(0.0, 1.0, size=INPUTS + STEPS),
    )


def assert_optimal(packed_one: QuadraticProgram, solution: list[float]) -> None:
    """Assert the Karush-Kuhn-Tucker conditions: multipliers exist, and only bounds that are reached have one."""
    program, z = dense(packed_one), np.array(solution)
    rows = program.A @ z
    assert np.all(rows >= program.l - TOLERANCE)
    assert np.all(rows <= program.u + TOLERANCE)
    # a positive multiplier pushes back from an upper bound, along its row, or from a lower one, against it
    reached = np.vstack([program.A[rows >= program.u - TOLERANCE], -program.A[rows <= program.l + TOLERANCE]])
    gradient = program.P @ z + program.q
    residual = nnls(reached.T, -gradient)[1] if len(reached) else np.linalg.norm(gradient)
    assert residual == pytest.approx(0.0, abs=2 * TOLERANCE)


@settings(max_examples=100)
@given(st.integers(0, 2**32 - 1))
def test_a_solution_satisfies_the_optimality_conditions(seed: int) -> None:
    program = random_program(seed)
    solution = QpSolver(INPUTS, STEPS, max_iterations=4000).solve(program)
    assert solution is not None
    assert_optimal(program, solution)


def test_one_workspace_solves_one_programme_after_the_other() -> None:
    solver = QpSolver(INPUTS, STEPS, max_iterations=4000)
    for seed in range(50):
        program = random_program(seed)
        solution = solver.solve(program)
        assert solution is not None
        assert_optimal(program, solution)


def test_only_vectors_or_only_one_matrix_may_change() -> None:
    solver, first, second = QpSolver(INPUTS, STEPS, max_iterations=4000), random_program(1), random_program(2)
    for program in (
        first,
        replace(first, q=second.q),
        replace(first, q=second.q, P=second.P),
        replace(second, P=first.P),
        second,
    ):
        wide = replace(program, l=[each - 5.0 for each in program.l], u=[each + 5.0 for each in program.u])
        solution = solver.solve(wide)
        assert solution is not None
        assert_optimal(wide, solution)


def test_a_box_gives_what_an_exact_solver_finds() -> None:
    # P = R'R, q = -R'b: the programme is a bounded least squares problem
    random = np.random.default_rng(5)
    root, target = random.normal(size=(6, INPUTS)), 3.0 * random.normal(size=6)
    bounds = np.array([0.5] * INPUTS + [1e6] * STEPS)
    box = packed_program(root.T @ root, -root.T @ target, np.tril(np.ones((STEPS, INPUTS))), -bounds, bounds)
    solution = QpSolver(INPUTS, STEPS).solve(box)
    exact = lsq_linear(root, target, (-0.5, 0.5), tol=1e-12).x
    assert solution is not None
    assert solution == pytest.approx(exact, abs=1e-4)
    assert 0 < np.sum(np.abs(exact) > 0.5 - 1e-6) < INPUTS


def test_an_infeasible_programme_has_no_solution_and_the_next_one_has() -> None:
    solver = QpSolver(INPUTS, STEPS, max_iterations=4000)
    good = random_program(3)
    low, high = np.full(INPUTS + STEPS, -1.0), np.full(INPUTS + STEPS, 1.0)
    low[-1] = high[-1] = INPUTS + 1.0  # the last output is the sum of the inputs
    cramped = packed_program(np.eye(INPUTS), np.zeros(INPUTS), np.tril(np.ones((STEPS, INPUTS))), low, high)
    for _ in range(3):
        assert solver.solve(cramped) is None
        solution = solver.solve(good)
        assert solution is not None
        assert_optimal(good, solution)


def test_crossed_bounds_have_no_solution_and_the_next_programme_has() -> None:
    solver, good = QpSolver(INPUTS, STEPS, max_iterations=4000), random_program(4)
    assert solver.solve(replace(good, l=good.u, u=good.l)) is None
    assert solver.solve(good) is not None


@pytest.mark.parametrize("name", ["P", "q", "A", "l", "u"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_not_finite_gives_no_solution_and_leaves_the_workspace_sound(name: str, bad: float) -> None:
    solver, good = QpSolver(INPUTS, STEPS, max_iterations=4000), random_program(6)
    values = list(getattr(good, name))
    values[1] = bad
    if name in {"P", "q"}:
        values[-1] = -bad  # opposite infinities must not cancel
    assert solver.solve(replace(good, **{name: values})) is None
    solution = solver.solve(good)
    assert solution is not None
    assert_optimal(good, solution)


@pytest.mark.parametrize("name", ["P", "q", "A", "l", "u"])
def test_an_array_of_the_wrong_size_is_refused(name: str) -> None:
    # OSQP itself takes a short q without a word
    good = random_program(7)
    short = getattr(good, name)[:-1]
    with pytest.raises(ValueError, match="workspace"):
        QpSolver(INPUTS, STEPS).solve(replace(good, **{name: short}))


def test_too_few_iterations_give_no_solution_instead_of_a_half_one() -> None:
    solver = QpSolver(INPUTS, STEPS, max_iterations=5)
    assert all(solver.solve(random_program(seed)) is None for seed in range(3))


def test_the_callers_arrays_are_neither_changed_nor_kept() -> None:
    solver, program = QpSolver(INPUTS, STEPS, max_iterations=4000), random_program(8)
    copies = {name: tuple(getattr(program, name)) for name in ("P", "q", "A", "l", "u")}
    first = solver.solve(program)
    for name, copy in copies.items():
        assert tuple(getattr(program, name)) == copy
    assert first is not None
    kept = first.copy()
    solver.solve(random_program(9))
    assert first == kept


def answers(solver: QpSolver) -> list[list[float] | None]:
    """Return what a solver answers to programmes that change in one part, in all parts, or have no solution."""
    found = []
    for seed in range(40):
        program, other = random_program(seed), random_program(seed + 1)
        found += [solver.solve(each) for each in (program, replace(program, q=other.q), replace(program, A=other.A))]
    return found


def test_the_same_sequence_of_programmes_gives_the_same_bits() -> None:
    first = answers(QpSolver(INPUTS, STEPS))
    assert first == answers(QpSolver(INPUTS, STEPS))
    assert 10 < first.count(None) < 60


@pytest.mark.parametrize("missing", ["update_data_vec", "update_data_mat", "warm_start", "info", "solution"])
def test_a_version_of_osqp_without_the_direct_calls_gives_the_same_bits(
    missing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = answers(QpSolver(INPUTS, STEPS))
    updates = []

    def counted(self: osqp.OSQP, **changes: np.ndarray) -> None:
        updates.append(set(changes))
        update(self, **changes)

    update = osqp.OSQP.update
    monkeypatch.setattr(osqp.OSQP, "update", counted)
    monkeypatch.setattr("positioner.optimization.solver._DIRECT_CALLS", (f"no {missing}",))
    assert answers(QpSolver(INPUTS, STEPS)) == expected
    assert len(updates) == len(expected)
    assert {"q", "l", "u"} in updates
