"""How well landings repeat is learned from where they end: by its likelihood, bounded, and forgotten again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from positioner.laws.nmpc.covariance import independent
from positioner.laws.nmpc.filter import AdaptiveFilter, Resting, Sliding, average
from positioner.laws.nmpc.repeatability import Repeatability
from positioner.laws.nmpc.settings import AdaptationSettings
from positioner.valve.motion import Load, MotionModel
from positioner.valve.parameters import ValveParameters

VALVE = ValveParameters(id="paper")
NOMINAL = Load.of(VALVE)
FILTER = AdaptiveFilter(AdaptationSettings(), MotionModel.of(VALVE), NOMINAL)
LANDING_M, READING_M = 4e-4, 1e-4


def rest_after(known: Repeatability, error_m: float) -> Resting:
    """Return the end of a rest whose readings show that the move ended this far beside its prediction."""
    covariance = independent(known.factor * LANDING_M**2, FILTER.prior_sigmas())
    stop = Sliding(0.08, 0.0, NOMINAL, covariance, 1.0, stopped=True, unforeseen=known.factor)
    rest = Resting(stop.x, covariance.xx, stop, Load(0.0, 0.0, 0.0))
    return average(rest, stop.x + error_m, READING_M**2)


def after(known: Repeatability, scatter_m: float, count: int, seed: int = 1) -> Repeatability:
    for error_m in np.random.default_rng(seed).normal(0.0, np.hypot(scatter_m, READING_M), count):
        known = known.followed_by(rest_after(known, float(error_m)))
    return known


@pytest.mark.parametrize(
    ("part", "least", "most"), [(1.0, 0.7, 1.0), (0.5, 0.12, 0.6), (0.25, 0.03, 0.2), (0.0, 0.0, 0.05)]
)
def test_the_factor_is_that_of_the_landings(part: float, least: float, most: float) -> None:
    factors = [after(Repeatability(), part * LANDING_M, 60, seed).factor for seed in range(5)]
    assert least <= float(np.median(factors)) <= most


def test_a_valve_that_no_longer_repeats_itself_is_believed_after_a_few_landings() -> None:
    precise = after(Repeatability(), 0.0, 200)
    assert precise.factor < 0.05
    assert after(precise, LANDING_M, 6).factor > 5.0 * precise.factor
    assert after(precise, LANDING_M, 60).factor > 0.5


def test_one_landing_far_away_is_an_outlier() -> None:
    precise = after(Repeatability(), 0.0, 200)
    assert precise.followed_by(rest_after(precise, 0.05)).factor < 0.3


def test_a_rest_that_no_predicted_motion_began_teaches_nothing() -> None:
    known, rest = Repeatability(), rest_after(Repeatability(), 1e-3)
    assert known.followed_by(replace(rest, anchor=replace(rest.anchor, unforeseen=0.0))) is known
    assert known.followed_by(replace(rest, variance_m2=rest.anchor.covariance.xx)) is known
