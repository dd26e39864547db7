from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from stem import GAIN, PERIOD_S, SETTINGS, SLIDING, SPRING, STATIC, Stem, moves_of, pushes

from positioner.health.moves import MoveTracker, follow

if TYPE_CHECKING:
    from positioner.health.move import Move


def sliding_n(move: Move) -> float:
    return move.direction * (move.force_n - SPRING * move.middle_m)


@pytest.mark.parametrize("friction", [0.85, 1.0, 1.3])
def test_the_work_of_a_move_shows_the_sliding_friction_of_an_independent_stem(friction: float) -> None:
    moves = moves_of(Stem(friction=friction), pushes(8))
    assert len(moves) >= 6
    assert {move.direction for move in moves} == {1.0, -1.0}
    for move in moves:
        assert move.complete
        assert sliding_n(move) == pytest.approx(friction * SLIDING, abs=0.03 * SLIDING)


def test_noise_scatters_the_friction_as_the_move_itself_says() -> None:
    off = []
    for seed in range(12):
        moves = moves_of(Stem(), pushes(10, seed), 63.5e-6, seed)
        off += [(sliding_n(move) - SLIDING) / move.force_sigma_n for move in moves if move.complete]
    assert len(off) > 80
    assert abs(sum(off) / len(off)) < 1.0
    assert 0.4 < math.sqrt(sum(each * each for each in off) / len(off)) < 2.0


def test_a_slow_ramp_shows_static_friction_between_the_currents_that_held_and_freed_the_stem() -> None:
    start_ma = SPRING * 0.07 / GAIN
    ramp = [start_ma + 0.01 * number for number in range(560)]
    (move,) = moves_of(Stem(), [start_ma] * 50 + ramp + [ramp[-1] - 4.0] * 60)
    static_n = move.slip_n - SPRING * move.before_m
    assert abs(static_n - STATIC) <= move.slip_half_n + 0.01 * GAIN
    assert move.slip_half_n < 0.01 * STATIC
    assert move.rest_s == pytest.approx(0.56, abs=0.02)


def test_a_sudden_push_says_that_it_shows_no_static_friction() -> None:
    moves = moves_of(Stem(), pushes(4))
    assert all(move.slip_half_n > 0.3 * STATIC for move in moves)


def test_a_stem_at_rest_makes_no_move_for_all_its_noise() -> None:
    assert moves_of(Stem(), [11.0] * 20_000, 63.5e-6) == []


def test_a_stem_that_turns_shows_no_friction() -> None:
    currents = [11.0] * 50 + [19.0] * 14 + [4.0] * 25 + [11.0] * 60
    assert [move.complete for move in moves_of(Stem(), currents)] == [False]


def test_a_lost_reading_within_a_move_shows_no_friction() -> None:
    stem, tracker, found = Stem(), MoveTracker(), []
    for number, current_ma in enumerate([11.0] * 50 + [18.0] * 20 + [11.0] * 60):
        position_m = stem.play(current_ma)
        elapsed_s = PERIOD_S * (2 if number == 56 else 1)
        if number != 55:
            found.append(follow(SETTINGS, tracker, number * PERIOD_S, elapsed_s, position_m, current_ma))
    assert [move.complete for move in found if move] == [False]


def test_a_move_from_a_rest_that_was_too_short_shows_no_friction() -> None:
    currents = [11.0] * 12 + [18.0] * 20 + [11.0] * 60
    assert [move.complete for move in moves_of(Stem(), currents)] == [False]
