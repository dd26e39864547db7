"""The learned sliding friction, against slips with a known mean and a known scatter, and with a spring that is not."""

from __future__ import annotations

import numpy as np
import pytest

from positioner.laws.nmpc.lagged.regression import OnsetRegression
from positioner.laws.nmpc.lagged.sliding_friction import after_slip

TRUE_N, BELIEVED_N = 1300.0, 1423.0
SPRING_N_PER_M, STATIC_N, X = 52000.0, 1700.0, 0.07


def believed(spring: float = 0.0, friction: float = 0.0, ratio: float = 0.05) -> OnsetRegression:
    """Return what is believed before the first slip, with these relative standard deviations."""
    kk, ff, of_static = (spring * SPRING_N_PER_M) ** 2, (friction * STATIC_N) ** 2, BELIEVED_N / STATIC_N
    cc = of_static * of_static * ff + (ratio * BELIEVED_N) ** 2
    return OnsetRegression(
        SPRING_N_PER_M, STATIC_N, 1.0, BELIEVED_N, kk, 0.0, 0.0, 0.0, ff, 0.0, of_static * ff, 0.0, 0.0, cc
    )


def slipped(
    known: OnsetRegression, scatter2: float, shown_n: float, noise_n: float, direction: float = 1.0
) -> tuple[OnsetRegression, float]:
    """Return what is believed after a slip that shows its F_c with this error."""
    own_n2 = known.slip_n2(X, direction, scatter2)
    gain = own_n2 / (own_n2 + noise_n * noise_n)
    found_n = known.sliding_n + gain * (shown_n - known.sliding_n)
    return after_slip(known, scatter2, X, direction, found_n, own_n2 * (1.0 - gain))


def after_slips(scatter: float, sigma: float, slips: int) -> list[tuple[OnsetRegression, float]]:
    """Return what is believed after each slip; each shows its F_c with a relative error of `sigma`."""
    random = np.random.default_rng(5)
    known, scatter2 = believed(), 0.03**2
    course = list[tuple[OnsetRegression, float]]()
    for _ in range(slips):
        shown_n = TRUE_N * (1.0 + scatter * random.standard_normal() + sigma * random.standard_normal())
        known, scatter2 = slipped(known, scatter2, shown_n, sigma * TRUE_N)
        course.append((known, scatter2))
    return course


@pytest.mark.parametrize("sigma", [0.005, 0.03])
@pytest.mark.parametrize("scatter", [0.02, 0.04])
def test_mean_and_scatter_of_the_slips_are_found(scatter: float, sigma: float) -> None:
    later = after_slips(scatter, sigma, 400)[100:]

    assert np.mean([known.sliding_n for known, _ in later]) == pytest.approx(TRUE_N, rel=0.01)
    assert np.mean([scatter2 for _, scatter2 in later]) ** 0.5 == pytest.approx(scatter, rel=0.3)


def test_slips_that_are_all_alike_are_soon_expected_to_be_so() -> None:
    known, scatter2 = after_slips(0.0, 0.02, 40)[-1]

    assert known.slip_n2(X, 1.0, scatter2) ** 0.5 < 0.02 * TRUE_N
    assert known.sliding_n == pytest.approx(TRUE_N, rel=0.02)


def test_a_friction_that_changes_at_once_is_followed_within_thirty_slips() -> None:
    known, scatter2 = after_slips(0.0, 0.02, 40)[-1]
    for _ in range(30):
        known, scatter2 = slipped(known, scatter2, 1.15 * TRUE_N, 0.02 * TRUE_N)

    assert known.sliding_n == pytest.approx(1.15 * TRUE_N, rel=0.035)


def test_a_slip_that_shows_nothing_teaches_nothing() -> None:
    known = believed()
    after, scatter2 = after_slip(known, 0.03**2, X, 1.0, known.sliding_n, known.slip_n2(X, 1.0, 0.03**2))

    assert (after.sliding_n, scatter2) == (known.sliding_n, 0.03**2)
    assert known.cc < after.cc < 1.05 * known.cc


@pytest.mark.parametrize(("spring", "friction"), [(1.25, 1.0), (1.0, 1.2), (0.85, 1.1)])
def test_onsets_and_slips_in_both_directions_tell_spring_and_friction_apart(spring: float, friction: float) -> None:
    known, scatter2 = believed(0.05, 0.12, 0.03), 0.03**2
    for direction in (1.0, -1.0, 1.0, -1.0):
        freed_n = spring * SPRING_N_PER_M * X + direction * friction * STATIC_N
        known = known.loosened(150.0, 17.0, 0.0).with_onset(X, direction, 0.0, freed_n, 34.0**2)
        wrong_n = direction * X * (spring * SPRING_N_PER_M - known.spring_n_per_m)
        known, scatter2 = slipped(known, scatter2, friction * BELIEVED_N + wrong_n, 10.0, direction)

    assert known.spring_n_per_m == pytest.approx(spring * SPRING_N_PER_M, rel=0.01)
    assert known.static_n == pytest.approx(friction * STATIC_N, rel=0.02)
    assert known.sliding_n == pytest.approx(friction * BELIEVED_N, rel=0.03)
