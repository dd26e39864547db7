from __future__ import annotations

import statistics
from dataclasses import replace

import pytest
from stem import GAIN, REFERENCE, SLIDING, SPAN, SPRING, Stem, moves_of, pushes

from positioner.health.friction_trend import Changes, FrictionTrend, after_move, changes

AVERAGING = 0.05


def after(stem: Stem, count: int = 100) -> Changes:
    trend = FrictionTrend()
    for move in moves_of(stem, pushes(count), 63.5e-6):
        trend = after_move(trend, REFERENCE, AVERAGING, move)
    assert trend.moves > 0.7 * count
    return changes(trend, REFERENCE, AVERAGING)


def test_a_valve_like_its_reference_shows_no_change() -> None:
    found = after(Stem())
    for share in (found.friction, found.spring, found.offset):
        assert abs(share.value) < 0.02
        assert share.low <= 0.005
        assert share.high >= -0.005


@pytest.mark.parametrize("period_s", [0.001, 0.002, 0.005, 0.01])
def test_friction_does_not_depend_on_the_period_of_the_readings(period_s: float) -> None:
    """At 5 ms readings alone miss so much of ∫v² dt that the moves show 2 % more friction, and short ones 6 %."""
    moves = [each for each in moves_of(Stem(), pushes(40), 63.5e-6, period_s=period_s) if each.complete]
    seen_n = [(each.force_n - REFERENCE.balance_n(each.middle_m)) / each.friction_part for each in moves]
    assert len(moves) > 30
    assert statistics.mean(seen_n) == pytest.approx(SLIDING, rel=0.003)


def test_the_interval_contains_an_unchanged_friction_in_95_of_100_runs() -> None:
    """The friction scatters from move to move as the trend expects it to; 30 moves at 5 ms, as after a commissioning.

    Of 100 intervals of 95 %, 89 to 99 contain the truth with a probability of 99 %.
    """
    contained = 0
    for seed in range(100):
        trend, stem = FrictionTrend(), Stem(step_s=5e-5)
        for move in moves_of(stem, pushes(30, seed), 63.5e-6, seed, 0.005, scatter=0.05):
            trend = after_move(trend, REFERENCE, 0.01, move)
        share = changes(trend, REFERENCE, 0.01).friction
        contained += share.low <= 0.0 <= share.high
    assert 89 <= contained <= 99


@pytest.mark.parametrize("friction", [0.75, 1.25])
def test_friction_is_what_sets_the_two_directions_apart(friction: float) -> None:
    found = after(Stem(friction=friction))
    assert found.friction.value == pytest.approx(friction - 1.0, abs=0.02)
    assert abs(found.spring.value) < 0.1
    assert not found.one_sided


def test_a_softer_spring_is_not_friction() -> None:
    found = after(Stem(spring=0.9))
    assert abs(found.friction.value) < 0.03
    assert found.offset.value * SPRING * SPAN == pytest.approx(-0.1 * SPRING * 0.075, rel=0.1)
    assert found.offset.high < 0.0


@pytest.mark.parametrize("offset_ma", [0.3, -0.3])
def test_an_offset_of_the_converter_is_not_friction(offset_ma: float) -> None:
    found = after(Stem(offset_ma=offset_ma))
    assert abs(found.friction.value) < 0.03
    assert found.offset.value * SPRING * SPAN == pytest.approx(-offset_ma * GAIN, rel=0.2)


def test_a_supply_that_limits_one_direction_is_one_sided() -> None:
    found = after(Stem(supply_ma=15.5))
    assert found.one_sided


def test_the_trend_forgets_at_the_rate_of_lambda() -> None:
    trend = FrictionTrend()
    moves = [move for move in moves_of(Stem(friction=1.2), pushes(60)) if move.complete]
    for move in moves:
        trend = after_move(trend, REFERENCE, AVERAGING, move)
    share = changes(trend, REFERENCE, AVERAGING).friction.value / 0.2
    assert 1.0 - 0.95 ** len(moves) - 0.1 < share < 1.05


def test_a_reference_by_place_is_compared_at_the_places_of_the_way() -> None:
    places = tuple((0.0025 + 0.005 * number, 1423.0 * (1.2 if number < 13 else 0.8)) for number in range(28))
    reference = replace(REFERENCE, by_place=places)
    assert reference.sliding_along_n(0.03, 0.05) == pytest.approx(1.2 * 1423.0)
    assert reference.sliding_along_n(0.1, 0.08) == pytest.approx(0.8 * 1423.0)
    assert reference.sliding_along_n(0.0701, 0.0702) == pytest.approx(0.8 * 1423.0)
    assert 0.8 * 1423.0 < reference.sliding_along_n(0.05, 0.08) < 1.2 * 1423.0
