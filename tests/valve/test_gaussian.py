"""A Gaussian over a few numbers, against the textbook's formulas in numpy and SciPy's truncated normal distribution."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from positioner.valve.gaussian import Gaussian, condensed, gaussian_of

PRIOR = Gaussian((150.0, 0.5, 4.0), (100.0, -3.0, 0.5, -3.0, 0.4, 0.02, 0.5, 0.02, 0.3))
LINE = (0.08, 1.0, -1.0)


def matrix(belief: Gaussian) -> np.ndarray:
    return np.array(belief.covariance).reshape(3, 3)


def test_a_measurement_is_that_of_the_kalman_filter() -> None:
    h, p = np.array(LINE), matrix(PRIOR)
    total = h @ p @ h + 0.04
    gain = p @ h / total

    after = PRIOR.updated(LINE, 0.7, 0.04)

    assert PRIOR.expected(LINE) == pytest.approx(h @ np.array(PRIOR.mean), rel=1e-12)
    assert PRIOR.variance(LINE) == pytest.approx(h @ p @ h, rel=1e-12)
    assert after.mean == pytest.approx(tuple(np.array(PRIOR.mean) + gain * 0.7), rel=1e-12)
    np.testing.assert_allclose(matrix(after), p - np.outer(gain, h @ p), atol=1e-12)


def test_numbers_that_one_cause_changes_change_together() -> None:
    spread = (0.0, 0.1, -0.3)
    after = PRIOR.changed(spread)
    np.testing.assert_allclose(matrix(after), matrix(PRIOR) + np.outer(spread, spread), rtol=1e-12)
    assert after.mean == PRIOR.mean
    assert after.updated((0.0, 1.0, 0.0), 0.1, 1e-9).mean[2] < PRIOR.updated((0.0, 1.0, 0.0), 0.1, 1e-9).mean[2]


@given(st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-3.0, 3.0)), min_size=1, max_size=30))
def test_a_covariance_stays_symmetric_and_positive(measurements: list[tuple[float, float]]) -> None:
    belief = PRIOR
    for place, innovation in measurements:
        belief = belief.updated((place, 1.0, 1.0 if place > 0.0 else -1.0), innovation, 1e-3)
        belief = belief.bounded((place, 1.0, 0.0), belief.expected((place, 1.0, 0.0)) - innovation, 1e-3)

    np.testing.assert_allclose(matrix(belief), matrix(belief).T, atol=1e-9)
    assert np.linalg.eigvalsh(matrix(belief)).min() > -1e-9


@pytest.mark.parametrize("bound", [-1.0, 0.0, 0.5, 1.0])
def test_a_bound_leaves_the_moments_of_the_truncated_normal_distribution(bound: float) -> None:
    belief = gaussian_of((0.3, 7.0), (0.8, 1.0)).bounded((1.0, 0.0), bound, 0.0)

    truncated = stats.truncnorm((bound - 0.3) / 0.8, np.inf, loc=0.3, scale=0.8)
    assert belief.mean == pytest.approx((truncated.mean(), 7.0), rel=1e-6)
    assert belief.covariance[0] == pytest.approx(max(truncated.var(), 0.1 * 0.64), rel=1e-6)
    assert belief.covariance[3] == 1.0


def test_a_bound_far_above_moves_the_mean_to_it() -> None:
    belief = gaussian_of((0.0,), (1.0,)).bounded((1.0,), 8.0, 0.0)

    assert belief.mean[0] == pytest.approx(stats.truncnorm(8.0, np.inf).mean(), rel=0.01)


def test_a_bound_far_below_teaches_nothing() -> None:
    assert PRIOR.bounded(LINE, PRIOR.expected(LINE) - 10.0, 0.01) is PRIOR


def test_a_number_becomes_less_certain_alone() -> None:
    before, after = matrix(PRIOR), matrix(PRIOR.widened(1, 0.25))
    before[1, 1] += 0.25

    np.testing.assert_array_equal(after, before)


def test_a_number_that_is_certain_stays_so_and_one_that_is_not_keeps_some_doubt() -> None:
    found = gaussian_of((1.0, 2.0), (0.0, 0.5))
    for _ in range(4):
        found = found.updated((3.0, 1.0), 0.7, 1e-14)
    assert (found.mean[0], found.covariance[:3]) == (1.0, (0.0, 0.0, 0.0))
    assert found.covariance[3] == 1e-10


def test_a_number_that_is_another_one_is_independent_of_the_others() -> None:
    after = PRIOR.renewed(1, 3.0, 0.04)
    known, left = matrix(PRIOR), [index for index in range(len(PRIOR.mean)) if index != 1]

    assert (after.mean[1], after.variances[1]) == (3.0, 0.04)
    np.testing.assert_array_equal(matrix(after)[np.ix_(left, left)], known[np.ix_(left, left)])
    assert not matrix(after)[1, left].any()
    assert not matrix(after)[left, 1].any()
    assert [after.mean[index] for index in left] == [PRIOR.mean[index] for index in left]


@given(st.integers(0, 2**32 - 1), st.integers(1, 70), st.sampled_from([None, 0, 1, 2]), st.booleans())
def test_condensed_measurements_say_what_all_of_them_say(
    seed: int, count: int, silent: int | None, dependent: bool
) -> None:
    draws = np.random.default_rng(seed)
    jacobian = draws.normal(size=(count, 3)) * (0.01, 1.0, 0.3)
    if silent is not None:
        jacobian[:, silent] = 0.0
    if dependent:
        jacobian[:, 2] = -2.0 * jacobian[:, 1]
    read = draws.normal(size=count)
    one_by_one = together = PRIOR
    for line, innovation in zip(jacobian, read, strict=True):
        left = innovation - line @ (np.array(one_by_one.mean) - PRIOR.mean)
        one_by_one = one_by_one.updated(tuple(line), float(left), 0.04)

    lines, found = condensed([list(column) for column in jacobian.T], list(read))

    assert len(lines) == np.linalg.matrix_rank(jacobian)
    for line, innovation in zip(lines, found, strict=True):
        left = innovation - np.array(line) @ (np.array(together.mean) - PRIOR.mean)
        together = together.updated(tuple(line), float(left), 0.04)
    assert together.mean == pytest.approx(one_by_one.mean, rel=1e-6, abs=1e-6)
    np.testing.assert_allclose(matrix(together), matrix(one_by_one), rtol=1e-6, atol=1e-6)
