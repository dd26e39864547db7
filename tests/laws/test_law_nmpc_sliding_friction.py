"""The learned sliding friction, against slips with a known mean and a known scatter."""

from __future__ import annotations

import numpy as np
import pytest

from positioner.laws.nmpc.lagged.sliding_friction import SlidingFriction, sliding_friction

TRUE_N, BELIEVED_N = 1300.0, 1423.0


def after_slips(scatter: float, sigma: float, slips: int) -> list[SlidingFriction]:
    """Return what is believed after each slip; each shows its F_c with a relative error of `sigma`."""
    random = np.random.default_rng(5)
    friction, course = sliding_friction(BELIEVED_N, 0.05, 0.03), []
    for _ in range(slips):
        shown_n = TRUE_N * (1.0 + scatter * random.standard_normal() + sigma * random.standard_normal())
        own_n2, noise_n2 = friction.slip_n2, (sigma * TRUE_N) ** 2
        gain = own_n2 / (own_n2 + noise_n2)
        found_n = friction.mean_n + gain * (shown_n - friction.mean_n)
        friction = friction.after_slip(found_n, own_n2 * (1.0 - gain))
        course.append(friction)
    return course


@pytest.mark.parametrize("sigma", [0.005, 0.03])
@pytest.mark.parametrize("scatter", [0.02, 0.04])
def test_mean_and_scatter_of_the_slips_are_found(scatter: float, sigma: float) -> None:
    later = after_slips(scatter, sigma, 400)[100:]

    assert np.mean([each.mean_n for each in later]) == pytest.approx(TRUE_N, rel=0.01)
    assert np.mean([each.scatter2 for each in later]) ** 0.5 == pytest.approx(scatter, rel=0.3)


def test_slips_that_are_all_alike_are_soon_expected_to_be_so() -> None:
    course = after_slips(0.0, 0.02, 40)

    assert course[-1].slip_n2 ** 0.5 < 0.02 * TRUE_N
    assert course[-1].mean_n == pytest.approx(TRUE_N, rel=0.02)


def test_a_friction_that_changes_at_once_is_followed_within_thirty_slips() -> None:
    friction = after_slips(0.0, 0.02, 40)[-1]
    for _ in range(30):
        own_n2, noise_n2 = friction.slip_n2, (0.02 * TRUE_N) ** 2
        gain = own_n2 / (own_n2 + noise_n2)
        friction = friction.after_slip(
            friction.mean_n + gain * (1.15 * TRUE_N - friction.mean_n), own_n2 * (1.0 - gain)
        )

    assert friction.mean_n == pytest.approx(1.15 * TRUE_N, rel=0.035)


def test_a_slip_that_shows_nothing_teaches_nothing() -> None:
    friction = sliding_friction(BELIEVED_N, 0.05, 0.03)
    after = friction.after_slip(friction.mean_n, friction.slip_n2)

    assert (after.mean_n, after.scatter2) == (friction.mean_n, friction.scatter2)
    assert friction.mean_n2 < after.mean_n2 < 1.05 * friction.mean_n2
