"""The parts of the search for an untold lag, each against a closed form or an independent computation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from positioner.laws.nmpc.lagged_settings import LaggedSettings
from positioner.laws.nmpc.untold import load as loads
from positioner.laws.nmpc.untold.candidate import Candidate, Pressures, candidates, pressures
from positioner.laws.nmpc.untold.course import Course, Finished, Piece, joined
from positioner.laws.nmpc.untold.found import actuator_of, settings_for
from positioner.laws.nmpc.untold.linear import factor, inverse, log_determinant, solved
from positioner.laws.nmpc.untold.probe import probe_of
from positioner.laws.nmpc.untold.rollout import Rollout, advanced, begun
from positioner.laws.nmpc.untold.watch import Quiet, Watch, with_kept, worked
from positioner.laws.nmpc.untold.work import Mind
from positioner.values import replace
from positioner.valve.actuator import ActuatorParameters
from positioner.valve.parameters import ValveParameters

PERIOD_S = 1e-3
NOMINAL = loads.nominal_of(ValveParameters(id="paper"))


def test_the_equations_are_solved_as_numpy_solves_them() -> None:
    random = np.random.default_rng(3)
    root = random.normal(size=(5, 5))
    matrix, right = root @ root.T + np.eye(5), random.normal(size=5)
    lower = factor(matrix.tolist())

    assert solved(lower, right.tolist()) == pytest.approx(np.linalg.solve(matrix, right).tolist())
    assert np.array(inverse(matrix.tolist())) == pytest.approx(np.linalg.inv(matrix))
    assert log_determinant(lower) == pytest.approx(np.linalg.slogdet(matrix).logabsdet)


@pytest.mark.parametrize("lag_s", [0.0005, 0.02, 0.3])
def test_the_pressure_of_a_lag_is_the_exponential(lag_s: float) -> None:
    pieces = (Piece(1, 20.0, 0.08), Piece(3, 4.0, 0.08))
    given = pressures(Candidate(lag_s), pieces, 12.0, PERIOD_S)
    peak_ma = 20.0 - 8.0 * math.exp(-PERIOD_S / lag_s)

    assert given.end_ma == pytest.approx(4.0 + (peak_ma - 4.0) * math.exp(-3.0 * PERIOD_S / lag_s))
    assert math.fsum(given.length_s) == pytest.approx(4.0 * PERIOD_S)
    # the mean of the first sample: ∫ of the exponential
    first = [step for step, piece in enumerate(given.piece) if piece == 0]
    mean_ma = sum(given.mean_ma[step] * given.length_s[step] for step in first) / PERIOD_S
    assert mean_ma == pytest.approx(20.0 - 8.0 * lag_s / PERIOD_S * (1.0 - math.exp(-PERIOD_S / lag_s)))


def test_a_dead_time_shifts_the_currents_by_samples() -> None:
    pieces = tuple(Piece(1, current_ma, 0.08) for current_ma in (20.0, 4.0, 13.0, 13.0))

    assert pressures(Candidate(0.0, 2), pieces, 12.0, PERIOD_S).mean_ma == [12.0, 12.0, 20.0, 4.0]


def test_lags_that_are_over_within_a_sample_are_no_candidates() -> None:
    assert [each.lag_s for each in candidates(0.02) if each.lag_s] == [0.01, 0.02, 0.05, 0.1, 0.2, 0.3]


def test_a_rest_is_joined_to_pieces_whose_length_grows_with_it() -> None:
    pieces: tuple[Piece, ...] = ()
    same = 0
    for sample in range(200):
        pieces, same = joined(pieces, same, 20.0 if sample < 3 else 12.0, float(sample))

    assert sum(piece.samples for piece in pieces) == 200
    assert len(pieces) < 30
    assert [piece.samples for piece in pieces[:6]] == [1] * 6
    ends = np.cumsum([piece.samples for piece in pieces])
    assert all(piece.samples <= 1 + end / 4 for piece, end in zip(pieces, ends, strict=True))
    assert pieces[-1].reading_m == pytest.approx(199 - (pieces[-1].samples - 1) / 2)


def test_the_force_between_two_others_is_the_truncated_normal_distribution() -> None:
    belief = loads.prior()
    course = Course(0.08, 1e-10, 1.0)
    freeing = loads.threshold(NOMINAL, belief, course)
    low, high = freeing.mean + 0.3 * freeing.sigma, freeing.mean + 1.1 * freeing.sigma
    found = freeing.between(belief, low, high)
    assert found is not None
    after, log_probability = found

    random = np.random.default_rng(5)
    drawn = random.multivariate_normal(belief.values, belief.covariance, size=400_000)
    lever = NOMINAL.load.spring_n_per_m * 0.08 / NOMINAL.static_n
    force = lever * drawn[:, 0] + drawn[:, 3] + random.normal(0.0, 0.02, size=len(drawn))
    inside = drawn[(force > low) & (force < high)]
    assert log_probability == pytest.approx(math.log(len(inside) / len(drawn)), abs=0.02)
    assert after.values == pytest.approx(inside.mean(axis=0).tolist(), abs=2e-3)
    assert np.array(after.covariance) == pytest.approx(np.cov(inside.T), abs=2e-4)
    assert freeing.between(belief, freeing.mean + 20.0 * freeing.sigma, 1e9) is None


def run(course: Course, given: Pressures, values: list[float], origin_mm: float, budget: int = 10_000) -> Rollout:
    rollout = begun(course, origin_mm)
    while rollout.step < len(given.piece):
        rollout = advanced(NOMINAL, course, given, values, 6, 1e-8, rollout, budget)
    return rollout


def test_one_run_gives_the_gauss_newton_step_of_every_parameter() -> None:
    pieces = tuple(Piece(1, 20.0 if sample < 5 else 13.0, 0.0) for sample in range(30))
    bare = Course(0.08, 1e-10, 1.0, pieces)
    given = pressures(Candidate(0.002), pieces, 12.6, PERIOD_S)
    # readings without noise, from the model itself
    seen = [
        run(
            Course(0.08, 1e-10, 1.0, pieces[:count]),
            pressures(Candidate(0.002), pieces[:count], 12.6, PERIOD_S),
            [1.0] * 4,
            0.0,
        ).x
        for count in range(1, 31)
    ]
    course = Course(
        0.08, 1e-10, 1.0, tuple(Piece(1, piece.current_ma, x) for piece, x in zip(bare.pieces, seen, strict=True))
    )
    assert 0.001 < course.moved_m < 0.03
    assert run(course, given, [1.0] * 4, 0.0).cost == pytest.approx(0.0, abs=1e-9)

    for index, change in enumerate((1e-3, 1e-4, 1e-4, 1e-4)):
        values = [1.0] * 4
        origin_mm = change if index == 0 else 0.0
        if index:
            values[index - 1] += change
        off = run(course, given, values, origin_mm)
        expected = [-change * off.information[each][index] for each in range(4)]
        assert off.gradient == pytest.approx(expected, rel=0.02, abs=0.02 * max(map(abs, expected)))


def test_a_run_in_small_parts_is_the_run_in_one() -> None:
    pieces = tuple(Piece(1, 20.0 if sample < 5 else 13.0, 0.081) for sample in range(30))
    course = Course(0.08, 1e-10, 1.0, pieces)
    given = pressures(Candidate(0.002), pieces, 12.6, PERIOD_S)
    whole, parts = run(course, given, [1.0] * 4, 0.0), run(course, given, [1.0] * 4, 0.0, budget=1)

    assert (whole.cost, whole.gradient, whole.x) == (parts.cost, parts.gradient, parts.x)


def test_a_rest_that_creeps_begins_anew() -> None:
    still, creeping = Quiet(), Quiet()
    for sample in range(60):
        reading_m = 0.08 + 1e-5 * (-1) ** sample
        still = still.followed_by(reading_m, 1e-10)
        creeping = creeping.followed_by(reading_m + 5e-6 * sample, 1e-10)

    assert still.readings == 60
    assert creeping.readings < 30


def watch_of(*evidence: tuple[float, float]) -> Watch:
    minds = tuple(Mind(Candidate(lag_s), loads.prior(), None, value) for lag_s, value in evidence)
    return Watch(minds, Quiet())


def test_the_lag_is_the_top_of_a_parabola_over_its_logarithm() -> None:
    level = watch_of((0.0, -50.0), (0.001, -8.0), (0.002, 0.0), (0.004, -8.0))
    shifted = watch_of((0.0, -50.0), (0.001, -2.0), (0.002, 0.0), (0.004, -8.0))

    assert actuator_of(level, PERIOD_S).fill_time_constant_s == pytest.approx(0.002)
    # the top of the parabola through (-1, -2), (0, 0), (1, -8) is at -0.3
    assert actuator_of(shifted, PERIOD_S).fill_time_constant_s == pytest.approx(0.002 * 2.0**-0.3)


def test_a_lead_decides_and_what_does_little_harm_needs_more() -> None:
    leads = [watch_of((0.0, -lead), (0.002, 0.0)).leader is not None for lead in (0.0, 7.0, 9.0)]
    short = [watch_of((0.0, -lead), (0.0005, 0.0)).leader is not None for lead in (15.0, 17.0)]
    late = [
        Watch(
            (Mind(Candidate(0.0), loads.prior(), None, -lead), Mind(Candidate(0.0, 1), loads.prior())), Quiet()
        ).leader
        for lead in (39.0, 41.0)
    ]

    assert leads == [False, False, True]
    assert short == [False, True]
    assert [each is not None for each in late] == [False, True]


def test_a_lag_that_is_kept_from_before_leads_and_does_not_decide() -> None:
    watch = with_kept(watch_of((0.0, 0.0), (0.001, 0.0), (0.002, 0.0)), 0.0017)

    assert [mind.evidence for mind in watch.minds] == [0.0, 0.0, 6.0]
    assert watch.leader is None
    assert with_kept(watch_of((0.0, 0.0), (0.001, 0.0)), 0.005) == watch_of((0.0, 0.0), (0.001, 0.0))


@pytest.mark.parametrize(
    ("unmoved", "lag_s", "behind", "wanted"),
    [(3, 0.002, 0.0, True), (2, 0.002, 0.0, False), (3, 0.002, 2.0, False), (3, 0.0005, 0.0, False)],
)
def test_an_experiment_is_wanted_where_pushes_fail_and_a_lag_may_be_the_reason(
    unmoved: int, lag_s: float, behind: float, *, wanted: bool
) -> None:
    watch = replace(watch_of((0.0, 0.0), (lag_s, -behind)), unmoved=unmoved)

    assert watch.wants_probe is wanted


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_an_experiment_pushes_less_than_what_failed_and_no_less_than_what_should_free_the_stem(
    direction: float,
) -> None:
    quiet = Quiet(10, 0.08, 0.08)
    far, near = (
        probe_of(quiet, 1e-8, 12.0, 12.0 + direction * 8.0, 12.0 + direction * gamma_ma, 0, PERIOD_S)
        for gamma_ma in (5.0, 7.0)
    )
    later = probe_of(quiet, 1e-8, 12.0, 12.0 + direction * 8.0, 12.0 + direction * 5.0, 1, PERIOD_S)

    assert far.current_ma == pytest.approx(12.0 + direction * 6.0)
    assert near.current_ma == pytest.approx(12.0 + direction * 7.0)
    assert later.current_ma == pytest.approx(12.0 + direction * 8.0)
    assert (far.left, later.left) == (12, 48)
    assert far.direction == direction


def test_an_experiment_ends_with_the_motion_or_its_time_and_then_rests() -> None:
    probe = probe_of(Quiet(10, 0.08, 0.08), 1e-8, 12.0, 20.0, 17.0, 0, PERIOD_S)
    still, moving = probe, probe
    for sample in range(1, 13):
        still, moving = still.followed_by(0.08, 1e-8), moving.followed_by(0.08 + 3e-4 * sample, 1e-8)
        if sample == 3:
            assert not moving.is_held

    assert (still.is_held, still.has_moved, still.is_over) == (False, False, False)
    assert moving.has_moved
    for _ in range(10):
        still = still.followed_by(0.08, 1e-8)
    assert still.is_over
    assert not still.has_moved


def test_after_a_short_lag_smaller_errors_are_worth_a_correction() -> None:
    own = LaggedSettings()
    short, long = (
        settings_for(own, ActuatorParameters(fill_time_constant_s=lag_s, vent_time_constant_s=lag_s))
        for lag_s in (0.002, 0.02)
    )

    assert own.tolerance_of_noise > short.tolerance_of_noise > 0.0
    assert long == own


@pytest.mark.parametrize(
    ("explained", "lag_s", "lead", "is_over"),
    [
        (8, 0.002, -6.0, False),
        (9, 0.002, -6.0, True),
        (9, 0.002, -4.0, False),
        (9, 0.0005, 2.0, True),
        (9, 0.0005, 4.0, False),
        (39, 0.0005, 4.0, True),
    ],
)
def test_the_watch_ends_after_some_courses_where_no_lag_is_likely_and_at_last_in_any_case(
    explained: int, lag_s: float, lead: float, *, is_over: bool
) -> None:
    # a course of one resting sample says nothing: its explanation changes no evidence that matters
    course = Course(0.08, 1e-10, 1.0, (Piece(1, 12.6, 0.08),))
    watch = replace(watch_of((0.0, 0.0), (lag_s, lead)), explained=explained, waiting=(Finished(course, (), 1e-8),))
    while watch.waiting or watch.work is not None:
        watch = worked(NOMINAL, watch, PERIOD_S)

    assert watch.explained == explained + 1
    assert watch.is_over is is_over
