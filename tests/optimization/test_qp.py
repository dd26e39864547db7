"""The programme in the inputs alone: its model against a simulation, its cost against eq. 17. A and B as there."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioner.optimization.qp import forced_response, tracking_cost

sizes = st.tuples(st.integers(1, 8), st.integers(1, 8), st.integers(1, 3), st.integers(0, 2**32 - 1))


@settings(max_examples=100)
@given(sizes)
def test_free_and_forced_response_are_the_simulation_step_by_step(case: tuple[int, int, int, int]) -> None:
    steps, control_steps, size, seed = case
    random = np.random.default_rng(seed)
    A, B, start = random.normal(size=(size, size)), random.normal(size=size), random.normal(size=size)  # noqa: N806 - see above
    inputs = random.normal(size=control_steps)
    forced = forced_response(A, B, steps, control_steps)
    assert forced.shape == (steps, size, control_steps)

    free = state = start
    for i in range(steps):
        held = inputs[i] if i < control_steps else inputs[-1]  # eq. 17: the last input is held
        free, state = A @ free, A @ state + B * held
        np.testing.assert_allclose(free + forced[i] @ inputs, state, rtol=1e-10, atol=1e-10)


def test_an_input_does_not_act_before_its_step() -> None:
    random = np.random.default_rng(7)
    forced = forced_response(random.normal(size=(2, 2)), B := random.normal(size=2), 5, 5)  # noqa: N806 - see above
    for i in range(5):
        assert not forced[i, :, i + 1 :].any()
        assert forced[i, :, i] == pytest.approx(B)


@settings(max_examples=100)
@given(sizes, st.floats(1e-6, 1e3), st.floats(-10.0, 10.0))
def test_the_cost_is_equation_17_but_for_a_constant(
    case: tuple[int, int, int, int], input_weight: float, reference: float
) -> None:
    steps, control_steps, _, seed = case
    random = np.random.default_rng(seed)
    position, free = random.normal(size=(steps, control_steps)), random.normal(size=steps)
    weight = random.uniform(0.0, 5.0, size=steps)
    hessian, gradient = tracking_cost(position, weight, input_weight)

    def condensed(z: np.ndarray) -> float:
        return float(0.5 * z @ hessian @ z - z @ gradient @ (reference - free))

    def written_out(z: np.ndarray) -> float:
        error = reference - free - position @ z
        return float(np.sum(weight * error**2) + input_weight * np.sum(z**2))

    one, other = random.normal(size=control_steps), random.normal(size=control_steps)
    difference = (written_out(one) - written_out(other)) / (2.0 * input_weight)
    scale = (written_out(one) + written_out(other)) / input_weight
    assert condensed(one) - condensed(other) == pytest.approx(difference, rel=1e-9, abs=1e-12 * scale)
    np.testing.assert_allclose(hessian, hessian.T, rtol=1e-12, atol=1e-15 * hessian.max())
    eigenvalues = np.linalg.eigvalsh(hessian)
    assert eigenvalues[0] >= 1.0 - 1e-9 * eigenvalues[-1]
