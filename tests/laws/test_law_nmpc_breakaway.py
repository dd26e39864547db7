"""Γ from table and model, what a restart remembers, the verification of a move, and the bias of landings."""

from __future__ import annotations

import math
from dataclasses import astuple, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from positioner.laws.nmpc.breakaway import breakaway, breakaway_lesson, load_from_table
from positioner.laws.nmpc.filter import AdaptiveFilter, Resting, average
from positioner.laws.nmpc.landing import Landing, landing_bias_m
from positioner.laws.nmpc.settings import AdaptationSettings, BreakawaySettings, VerificationSettings
from positioner.laws.nmpc.verification import RestMonitor, Verification, verify
from positioner.valve.motion import Load, MotionModel
from positioner.valve.parameters import ValveParameters
from positioner.valve.stiction import Direction, Quantity, StictionTable

VALVE = ValveParameters(id="paper", bench_set_n=200.0)
MODEL = MotionModel.of(VALVE)
NOMINAL = Load.of(VALVE)
FILTER = AdaptiveFilter(AdaptationSettings(), MODEL, NOMINAL)
SIGMAS = FILTER.prior_sigmas()
SETTINGS = BreakawaySettings()
RATIO = 1.2
SIGMA_M = 1.6e-3


def gamma_ma(spring: float, static_n: float, x: float, s: float) -> float:
    return (spring * x + s * static_n + VALVE.bench_set_n) / VALVE.force_gain_n_per_ma


def taught(spring: float, static_n: float, places: tuple[float, ...], times: int = 3) -> StictionTable:
    table = StictionTable()
    for _ in range(times):
        for x in places:
            for s in (1.0, -1.0):
                one = breakaway_lesson(MODEL, table.cell_width_m, x, s, spring, static_n)
                table = table.learned(one)
    return table


@given(st.floats(0.07, 0.09), st.sampled_from((1.0, -1.0)))
def test_what_the_table_was_taught_anywhere_in_a_cell_holds_everywhere_in_it(x: float, s: float) -> None:
    table = taught(50e3, 1900.0, (0.0713, 0.0762, 0.0787, 0.0834, 0.0871, 0.0889))
    found = breakaway(SETTINGS, MODEL, table, x, s, 50e3, 1700.0)
    assert found.samples >= 3
    assert found.source.startswith("the table")
    assert found.current_ma == pytest.approx(gamma_ma(50e3, 1900.0 + SETTINGS.margin * 1700.0, x, s), abs=1e-9)


@pytest.mark.parametrize("s", [1.0, -1.0])
def test_a_push_from_a_table_that_is_too_weak_has_nine_tenths_of_the_models_friction(s: float) -> None:
    centre_m = taught(50e3, 600.0, (0.08,)).index_of(0.08) * 0.005
    for static_n, expected_n in ((600.0, 0.9 * 1700.0), (1600.0, 1600.0)):
        table = taught(50e3, static_n, (0.08,))
        found = breakaway(SETTINGS, MODEL, table, centre_m, s, 50e3, 1700.0)
        wanted_ma = gamma_ma(50e3, expected_n + SETTINGS.margin * 1700.0, centre_m, s)
        assert found.current_ma == pytest.approx(wanted_ma, abs=1e-9)


@pytest.mark.parametrize("s", [1.0, -1.0])
def test_a_thin_a_stale_and_a_scattered_cell_leave_it_to_the_model(s: float) -> None:
    direction = Direction.OPENING if s > 0.0 else Direction.CLOSING
    model = gamma_ma(50e3, 1700.0 * (1.0 + SETTINGS.margin), 0.08, s)
    thin = taught(50e3, 1900.0, (0.08,), times=2)
    stale = taught(50e3, 1900.0, (0.08,))
    for _ in range(SETTINGS.largest_age + 1):
        stale = stale.record(Quantity.STICK_SPEED, 0.01, direction, 0.1)
    scattered = taught(50e3, 1900.0, (0.08,)).record(Quantity.BREAKAWAY_CURRENT, 0.08, direction, 14.0)
    for table in (StictionTable(), thin, stale, scattered):
        found = breakaway(SETTINGS, MODEL, table, 0.08, s, 50e3, 1700.0)
        assert found.current_ma == pytest.approx(model)
        assert found.source == "the model"


@given(st.floats(0.8, 1.2), st.floats(0.8, 1.2))
def test_a_restart_remembers_spring_and_friction_from_the_table(spring: float, grip: float) -> None:
    truth = Load(spring * NOMINAL.spring_n_per_m, grip * NOMINAL.friction_n, grip * NOMINAL.viscous_n_s_per_m)
    table = taught(truth.spring_n_per_m, RATIO * truth.friction_n, (0.073, 0.08, 0.087))
    load, sigmas = load_from_table(SETTINGS, MODEL, table, NOMINAL, SIGMAS, RATIO)
    assert astuple(load) == pytest.approx(astuple(truth), rel=0.02)
    assert sigmas.spring_n_per_m < 0.15 * SIGMAS.spring_n_per_m
    assert sigmas.friction_n < 0.2 * SIGMAS.friction_n


@pytest.mark.parametrize(
    ("places", "highest"),
    # cells far from each other say more about the spring: 12 old samples there count half as much as 6 new ones
    [((0.073, 0.08, 0.087), 0.92), ((0.0605, 0.1005, 0.0705), 0.955)],
)
def test_a_restart_believes_what_was_learned_last(places: tuple[float, ...], highest: float) -> None:
    # first the nominal valve, in the same cells or in others, then one with a softer spring and more friction
    table = taught(NOMINAL.spring_n_per_m, RATIO * NOMINAL.friction_n, places, times=2)
    for x in (0.073, 0.08, 0.087):
        for s in (1.0, -1.0):
            one = breakaway_lesson(
                MODEL, table.cell_width_m, x, s, 0.9 * NOMINAL.spring_n_per_m, 1.05 * RATIO * NOMINAL.friction_n
            )
            table = table.learned(one)
    assert table.sequence == 18
    load, _ = load_from_table(BreakawaySettings(largest_spread=1.0), MODEL, table, NOMINAL, SIGMAS, RATIO)
    assert 0.895 < load.spring_n_per_m / NOMINAL.spring_n_per_m < highest
    assert 1.02 < load.friction_n / NOMINAL.friction_n < 1.06


def test_an_empty_or_stale_table_remembers_nothing() -> None:
    stale = replace(taught(45e3, 1500.0, (0.08,)), sequence=10_000)
    for table in (StictionTable(), stale):
        load, sigmas = load_from_table(SETTINGS, MODEL, table, NOMINAL, SIGMAS, RATIO)
        assert astuple(load) == pytest.approx(astuple(NOMINAL))
        assert astuple(sigmas) == pytest.approx(astuple(SIGMAS))


@pytest.mark.parametrize("friction_n", [0.0, 1e-12, 1e-3, 1.0])
@pytest.mark.parametrize("margin", [0.0, 0.02])
def test_a_valve_without_friction_remembers_what_its_table_can_tell(friction_n: float, margin: float) -> None:
    # 10 N of breakaway force in its table, as learned from a slip that was not predicted
    table = taught(NOMINAL.spring_n_per_m, 10.0, (0.073, 0.08, 0.087))
    prior = replace(NOMINAL, friction_n=friction_n)
    sigmas = AdaptiveFilter(AdaptationSettings(), MODEL, prior).prior_sigmas()
    load, sure = load_from_table(BreakawaySettings(margin=margin), MODEL, table, prior, sigmas, 1.0)
    assert all(map(math.isfinite, (*astuple(load), *astuple(sure))))
    assert load.spring_n_per_m == pytest.approx(NOMINAL.spring_n_per_m, rel=0.01)
    assert 0.0 < sure.spring_n_per_m <= sigmas.spring_n_per_m


NOISE_M2 = (SIGMA_M**2, SIGMA_M**2, SIGMA_M**2)
"""Of a reading in an average, as an outlier is judged, and alone: white noise."""


def verified(readings_at_m: float, count: int = 400) -> tuple[RestMonitor, Resting, Verification | None]:
    """Return the outcome of a move of 1 mm from 80 mm whose stem is then read at `readings_at_m`."""
    origin = FILTER.at_rest(0.08, (5e-5) ** 2, NOMINAL, SIGMAS)
    stem = FILTER.at_rest(0.081, (2e-4) ** 2, replace(NOMINAL, friction_n=1500.0), SIGMAS)
    state = RestMonitor(RATIO, verification=Verification(origin, 1.0, at_limit=True), landing=Landing(0.08, 0.081, 1.0))
    for _ in range(count):
        after = average(stem, readings_at_m, SIGMA_M**2)
        state, stem, decided = verify(VerificationSettings(), state, stem, after, readings_at_m, *NOISE_M2)
        if decided is not None:
            return state, stem, decided
    return state, stem, None


def test_a_push_that_freed_the_stem_lowers_static_friction_a_little() -> None:
    state, stem, decided = verified(0.081)
    assert decided is not None
    assert state.ratio == pytest.approx(RATIO * (1.0 - VerificationSettings().ratio_fall), rel=1e-4)
    assert stem.x == pytest.approx(0.081)
    assert state.landing == Landing(0.08, 0.081, 1.0)


def test_a_push_that_failed_is_undone_and_raises_static_friction() -> None:
    state, stem, decided = verified(0.08)
    assert decided is not None
    # by the part that the evidence of 4 leaves to "moved", which is the likelier one before any evidence
    assert RATIO * 1.02 < state.ratio < RATIO * (1.0 + VerificationSettings().ratio_rise)
    assert stem.x == pytest.approx(0.08)
    assert astuple(stem.load) == pytest.approx(astuple(NOMINAL))
    assert state.landing is None
    assert state.verification is None


def test_a_move_too_small_to_tell_ends_without_a_lesson() -> None:
    origin = FILTER.at_rest(0.08, (2e-4) ** 2, NOMINAL, SIGMAS)
    stem = FILTER.at_rest(0.0801, (2e-4) ** 2, NOMINAL, SIGMAS)
    state = RestMonitor(
        RATIO, verification=Verification(origin, 1.0, at_limit=True), landing=Landing(0.08, 0.0801, 1.0)
    )
    state, _, decided = verify(VerificationSettings(), state, stem, stem, 0.08005, *NOISE_M2)
    assert decided is None
    assert (state.verification, state.landing) == (None, None)
    assert state.ratio == pytest.approx(RATIO, rel=1e-3)


def test_static_friction_rises_no_further_than_it_may() -> None:
    origin, stem = (FILTER.at_rest(x, 1e-8, NOMINAL, SIGMAS) for x in (0.08, 0.09))
    for ratio in (VerificationSettings().ratio_most, 5.0):
        state = RestMonitor(ratio, verification=Verification(origin, 1.0, at_limit=True))
        decided = None
        while decided is None:
            state, _, decided = verify(VerificationSettings(), state, stem, stem, 0.08, *NOISE_M2)
        assert state.ratio == ratio


@pytest.mark.parametrize(("shift_m", "noticed"), [(0.0, False), (1e-3, False), (4e-3, True)])
def test_a_stem_that_leaves_its_rest_is_noticed(shift_m: float, noticed: bool) -> None:
    rest, state = FILTER.at_rest(0.08, 1e-10, NOMINAL, SIGMAS), RestMonitor(RATIO)
    for _ in range(40):
        state = state.with_reading(VerificationSettings(), rest, 0.08 + shift_m, SIGMA_M**2, SIGMA_M)
    assert state.finds_unexpected_move(VerificationSettings()) is noticed


def test_a_landing_bias_counts_once_it_is_beyond_doubt() -> None:
    table = StictionTable()
    assert landing_bias_m(table, 0.08, 1.0) == 0.0
    for bias in (4e-4, 5e-4, 6e-4, 5e-4):
        assert landing_bias_m(table.record(Quantity.LANDING_BIAS, 0.08, Direction.OPENING, -bias), 0.08, 1.0) <= 0.0
        (sample,) = Landing(0.07, 0.08, 1.0).samples(FILTER.at_rest(0.08 + bias, 1e-10, NOMINAL, SIGMAS))
        table = table.learned(sample)
    assert landing_bias_m(table, 0.08, 1.0) == pytest.approx(5e-4)
    assert landing_bias_m(table, 0.08, -1.0) == 0.0
    for bias in (-4e-4, -6e-4, 5e-4, -5e-4):
        table = table.record(Quantity.LANDING_BIAS, 0.08, Direction.OPENING, bias)
    assert landing_bias_m(table, 0.08, 1.0) == 0.0


@pytest.mark.parametrize(("rest_m", "teaches"), [(0.0805, True), (0.0815, True), (0.0792, False), (0.0828, False)])
def test_a_landing_beside_its_aim_by_more_than_the_way_teaches_nothing(rest_m: float, teaches: bool) -> None:
    there = FILTER.at_rest(rest_m, 1e-10, NOMINAL, SIGMAS)
    taught = Landing(0.08, 0.081, 1.0).samples(there)
    assert [each.value for each in taught] == ([pytest.approx(rest_m - 0.081)] if teaches else [])


@pytest.mark.parametrize(("stop_m", "planned"), [(0.08, False), (0.0807, True), (0.0813, True), (0.0825, False)])
def test_a_stop_that_the_model_saw_elsewhere_is_no_landing(stop_m: float, planned: bool) -> None:
    there = FILTER.at_rest(stop_m, 1e-8, NOMINAL, SIGMAS)
    assert there.sigma_m == pytest.approx(2.2e-4, abs=1e-5)
    assert Landing(0.08, 0.081, 1.0).is_planned(there) is planned


def test_one_outlier_decides_nothing() -> None:
    origin, stem = (FILTER.at_rest(x, 1e-8, NOMINAL, SIGMAS) for x in (0.08, 0.081))
    state = RestMonitor(RATIO, verification=Verification(origin, 1.0, at_limit=True))
    state, _, decided = verify(VerificationSettings(), state, stem, stem, 0.06, *NOISE_M2)
    assert decided is None
    assert state.verification is not None
    assert abs(state.verification.evidence) < 0.5
