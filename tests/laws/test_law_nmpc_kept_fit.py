"""What the law `nmpc` on a valve with actuator lag keeps over a restart."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.scenario import Scenario
from positioner.laws.law import Observation
from positioner.laws.nmpc.lagged.kept import fit_of
from positioner.laws.nmpc.lagged.law import LaggedLaw
from positioner.laws.nmpc.lagged.regression import OnsetRegression
from positioner.valve.fit import ValveFit
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from positioner.laws.nmpc.lagged.memory import LaggedMemory

QUIET = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}
FIT = ValveFit(50000.0, 1800.0, 0.055, 0.045, 4e4, -1e3, 0.0, 900.0, 0.0, 1e-4, 0.04, 1500.0, 400.0)


def scenario(**plant: Any) -> Scenario:
    lags = {"fill_time_constant_s": 0.05, "vent_time_constant_s": 0.05}
    return Scenario(
        name="kept",
        title="kept",
        law="nmpc-predictive",
        seed=7,
        setpoints_mm=(73.0, 87.0, 80.0, 81.5, 73.0),
        dwell_s=1.5,
        plant={"preset": "paper", "actuator": lags, "sensor": QUIET, **plant},
        valve={"actuator": lags},
        estimator=QUIET,
    )


def begun(fit: ValveFit) -> tuple[LaggedLaw, LaggedMemory, str]:
    """Return the law, its memory after its first cycle with a table that keeps `fit`, and what it told."""
    law = configure(scenario()).make_law()
    assert isinstance(law, LaggedLaw)
    seen = Observation(0.08, 12.6, 1e-3, 0.08, 0.0)
    memory, estimate = law.estimate(law.begin(0.08), seen)
    memory, decision = law.decide(memory, estimate.stem, seen, StictionTable(fit=fit))
    return law, memory, decision.fallback


def test_a_restarted_law_begins_with_the_kept_valve() -> None:
    _, memory, told = begun(FIT)
    onsets = memory.belief.onsets

    assert (onsets.spring_n_per_m, onsets.static_n, memory.belief.sliding_n) == (50000.0, 1800.0, 1500.0)
    assert onsets.lag == pytest.approx(1.1)
    assert (memory.drive.fill_s, memory.drive.vent_s) == pytest.approx((0.055, 0.045))
    assert told == ""


def test_it_is_less_sure_than_before_and_surer_than_of_the_configuration() -> None:
    law, memory, _ = begun(FIT)
    kept, prior = memory.belief.onsets, law.begin(0.08).belief.onsets

    assert FIT.ff < kept.ff < prior.ff
    assert FIT.kk < kept.kk < prior.kk
    assert FIT.tt < kept.tt < prior.tt


def test_a_fit_that_nobody_can_trust_any_more_is_as_the_configuration() -> None:
    law, memory, _ = begun(FIT.aged(86_400 * 3650))
    kept, prior = memory.belief.onsets, law.begin(0.08).belief.onsets

    assert (kept.kk, kept.ff, kept.tt, kept.cc) == pytest.approx((prior.kk, prior.ff, prior.tt, prior.cc))


def test_looser_variances_are_cut_without_changing_their_correlations() -> None:
    before = OnsetRegression(5e4, 1700.0, 1.0, 1400.0, 4e6, -1e4, 20.0, 3e3, 100.0, 0.5, 30.0, 0.09, 0.2, 50.0)
    after = before.no_looser(1e6, 1e9, 0.01, 20.0)

    def correlations(own: OnsetRegression) -> list[float]:
        covariance = np.array(
            [
                [own.kk, own.kf, own.kt, own.kc],
                [own.kf, own.ff, own.ft, own.fc],
                [own.kt, own.ft, own.tt, own.tc],
                [own.kc, own.fc, own.tc, own.cc],
            ]
        )
        sigma = np.sqrt(np.diag(covariance))
        return [float(value) for value in (covariance / np.outer(sigma, sigma)).ravel()]

    assert (after.kk, after.ff, after.tt, after.cc) == pytest.approx((1e6, 100.0, 0.01, 20.0))
    assert correlations(after) == pytest.approx(correlations(before))


@pytest.mark.parametrize(
    "other",
    [
        replace(FIT, spring_n_per_m=80000.0),
        replace(FIT, static_n=900.0),
        replace(FIT, fill_s=0.5),
        replace(FIT, vent_s=0.0),
        replace(FIT, sliding_n=5000.0),
    ],
)
def test_the_fit_of_another_valve_is_one_line_and_not_used(other: ValveFit) -> None:
    law, memory, told = begun(other)

    assert told == "the K, F_s, F_c or lag that the table keeps is not of the configured valve, and is not used"
    assert memory.belief == law.begin(0.08).belief


def test_what_is_kept_is_what_was_kept() -> None:
    _, memory, _ = begun(FIT)
    again = fit_of(memory)

    assert (again.spring_n_per_m, again.static_n, again.sliding_n) == (50000.0, 1800.0, 1500.0)
    assert (again.fill_s, again.vent_s) == pytest.approx((0.055, 0.045))


def test_the_table_of_a_run_keeps_the_true_valve() -> None:
    table = run_in_process(scenario(valve={"static_friction_n": 1900.0, "initial_position_m": 0.08})).table

    assert table.fit is not None
    assert abs(table.fit.static_n - 1900.0) < 2.0 * math.sqrt(table.fit.ff) < 400.0
    assert table.fit.spring_n_per_m == pytest.approx(52538.0, rel=0.03)
