"""The quadratic programme solver: its answers against their optimality conditions, its refusals, its repeatability."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear, nnls

from positioner.optimization.qp import QuadraticProgram
from positioner.optimization.solver import QpSolver

VARIABLES, CONSTRAINTS = 4, 8
TOLERANCE = 1e-3
"""OSQP ends at residuals of 1e-5, absolute and relative to terms of up to some tens here."""


def random_program(seed: int, *, variables: int = VARIABLES, constraints: int = CONSTRAINTS) -> QuadraticProgram:
    """Return a convex programme that has a solution: a random point is inside its constraints."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(variables, variables))
    rows = random.normal(size=(constraints, variables))
    inside = rows @ random.normal(size=variables)
    return QuadraticProgram(
        root.T @ root + np.eye(variables),
        5.0 * random.normal(size=variables),
        rows,
        inside - random.uniform(0.0, 1.0, size=constraints),
        inside + random.uniform(0.0, 1.0, size=constraints),
    )


def assert_optimal(program: QuadraticProgram, z: np.ndarray) -> None:
    """Assert the Karush-Kuhn-Tucker conditions: multipliers exist, and only bounds that are reached have one."""
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
    solution = QpSolver(VARIABLES, CONSTRAINTS, max_iterations=4000).solve(program)
    assert solution is not None
    assert_optimal(program, solution)


def test_one_workspace_solves_one_programme_after_the_other() -> None:
    solver = QpSolver(VARIABLES, CONSTRAINTS, max_iterations=4000)
    for seed in range(50):
        program = random_program(seed)
        solution = solver.solve(program)
        assert solution is not None
        assert_optimal(program, solution)


def test_only_vectors_or_only_one_matrix_may_change() -> None:
    solver, first, second = QpSolver(VARIABLES, CONSTRAINTS, max_iterations=4000), random_program(1), random_program(2)
    for program in (
        first,
        replace(first, q=second.q),
        replace(first, q=second.q, P=second.P),
        replace(second, P=first.P),
        second,
    ):
        program = replace(program, l=program.l - 5.0, u=program.u + 5.0)  # noqa: PLW2901 - still the case, made feasible
        solution = solver.solve(program)
        assert solution is not None
        assert_optimal(program, solution)


def test_a_box_gives_what_an_exact_solver_finds() -> None:
    # P = R'R, q = -R'b: the programme is a bounded least squares problem
    random = np.random.default_rng(5)
    root, target = random.normal(size=(6, VARIABLES)), 3.0 * random.normal(size=6)
    box = QuadraticProgram(
        root.T @ root, -root.T @ target, np.eye(VARIABLES), np.full(VARIABLES, -0.5), np.full(VARIABLES, 0.5)
    )
    solution = QpSolver(VARIABLES, VARIABLES).solve(box)
    exact = lsq_linear(root, target, (-0.5, 0.5), tol=1e-12).x
    assert solution is not None
    assert solution == pytest.approx(exact, abs=1e-4)
    assert 0 < np.sum(np.abs(exact) > 0.5 - 1e-6) < VARIABLES


def test_an_infeasible_programme_has_no_solution_and_the_next_one_has() -> None:
    solver = QpSolver(VARIABLES, CONSTRAINTS, max_iterations=4000)
    good = random_program(3)
    rows = np.vstack([np.ones((CONSTRAINTS - 1, VARIABLES)), np.ones((1, VARIABLES))])
    low, high = np.full(CONSTRAINTS, -1.0), np.full(CONSTRAINTS, 1.0)
    low[-1] = high[-1] = 5.0
    for _ in range(3):
        assert solver.solve(replace(good, A=rows, l=low, u=high)) is None
        solution = solver.solve(good)
        assert solution is not None
        assert_optimal(good, solution)


def test_crossed_bounds_have_no_solution_and_the_next_programme_has() -> None:
    solver, good = QpSolver(VARIABLES, CONSTRAINTS, max_iterations=4000), random_program(4)
    assert solver.solve(replace(good, l=good.u, u=good.l)) is None
    assert solver.solve(good) is not None


@pytest.mark.parametrize("name", ["P", "q", "A", "l", "u"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_not_finite_gives_no_solution_and_leaves_the_workspace_sound(name: str, bad: float) -> None:
    solver, good = QpSolver(VARIABLES, CONSTRAINTS, max_iterations=4000), random_program(6)
    array = getattr(good, name).copy()
    array.flat[1] = bad
    if name in {"P", "q"}:
        array.flat[-1] = -bad  # opposite infinities must not cancel, nor warn
    assert solver.solve(replace(good, **{name: array})) is None
    solution = solver.solve(good)
    assert solution is not None
    assert_optimal(good, solution)


@pytest.mark.parametrize("name", ["P", "q", "A", "l", "u"])
def test_an_array_of_the_wrong_size_is_refused(name: str) -> None:
    # OSQP itself takes a short q without a word
    good = random_program(7)
    short = getattr(good, name)[:-1].copy()
    with pytest.raises(ValueError, match="workspace"):
        QpSolver(VARIABLES, CONSTRAINTS).solve(replace(good, **{name: short}))


def test_too_few_iterations_give_no_solution_instead_of_a_half_one() -> None:
    solver = QpSolver(VARIABLES, CONSTRAINTS, max_iterations=5)
    assert all(solver.solve(random_program(seed)) is None for seed in range(3))


def test_the_callers_arrays_are_neither_changed_nor_kept() -> None:
    solver, program = QpSolver(VARIABLES, CONSTRAINTS, max_iterations=4000), random_program(8)
    copies = {name: getattr(program, name).copy() for name in ("P", "q", "A", "l", "u")}
    first = solver.solve(program)
    for name, copy in copies.items():
        np.testing.assert_array_equal(getattr(program, name), copy)
    assert first is not None
    kept = first.copy()
    solver.solve(random_program(9))
    np.testing.assert_array_equal(first, kept)


def test_the_same_sequence_of_programmes_gives_the_same_bits() -> None:
    def run() -> bytes:
        solver = QpSolver(VARIABLES, CONSTRAINTS)
        answers = [solver.solve(random_program(seed)) for seed in range(40)]
        return b"".join(b"-" if each is None else each.tobytes() for each in answers)

    assert run() == run()
