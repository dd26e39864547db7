"""The start of the passes: the fastest inputs keep the bound, and nearly always they are the plan already."""

from __future__ import annotations

import random

import numpy as np
import pytest
from dense import dense

from positioner.laws.nmpc.move import Move
from positioner.laws.nmpc.plan import plan_move
from positioner.laws.nmpc.prediction import predict
from positioner.laws.nmpc.programme import program
from positioner.laws.nmpc.settings import ApproachSettings
from positioner.laws.nmpc.start import fastest, multipliers
from positioner.optimization.solver import QpSolver
from positioner.valve.motion import Load, MotionModel
from positioner.valve.parameters import ValveParameters

VALVE = ValveParameters(id="paper")
MODEL = MotionModel.of(VALVE)


def some_moves(count: int) -> list[tuple[Move, float]]:
    """Return moves of sliding stems that can still stop before their target, and their sample periods."""
    chance, moves = random.Random(5), list[tuple[Move, float]]()  # noqa: S311 - moves that can be repeated, no secret
    while len(moves) < count:
        load = Load(chance.uniform(42e3, 58e3), chance.uniform(1100.0, 1700.0), chance.uniform(450.0, 750.0))
        s, x, period_s = chance.choice((1.0, -1.0)), chance.uniform(0.074, 0.082), chance.choice((1e-4, 1e-3))
        target = x + s * chance.uniform(2e-4, 6e-3)
        middle, friction_ma = MODEL.current_ma(load.spring_n_per_m * target), load.friction_n / MODEL.gain_n_per_ma
        weakest, brake = middle - s * 0.8 * friction_ma, middle - s * 0.3 * friction_ma
        strongest = 20.0 if s > 0.0 else 4.0
        move = Move(x, s * chance.uniform(0.01, 1.5), s, target, load, brake, weakest, strongest, weakest)
        if s * (move.smallest_m(move.slide(MODEL, period_s)) - target) < 0.0:
            moves.append((move, period_s))
    return moves


@pytest.mark.parametrize("count", [1, 4, 20])
def test_the_fastest_inputs_are_full_current_then_one_between_then_the_braking_current(count: int) -> None:
    for move, period_s in some_moves(100):
        slide, limits = move.slide(MODEL, period_s), move.limits(count)
        inputs = fastest(slide, limits, move.x, move.v, move.target_m)
        full = inputs.count(move.strongest_ma)
        assert inputs[:full] == [move.strongest_ma] * full
        assert inputs[full + 1 :] == [move.brake_ma] * (count - full - 1)
        stops = predict(slide, count, move.x, move.v, move.target_m, inputs).stops
        past_m = [move.direction * (each - move.target_m) for each in stops]
        assert max(past_m) < 1e-6
        # it is used up, unless full current throughout does not endanger the stop
        if full < count:
            assert past_m[-1] == pytest.approx(0.0, abs=1e-6)


def test_a_stem_too_fast_for_its_target_is_braked() -> None:
    load = Load.of(VALVE)
    move = Move(0.08, 2.0, 1.0, 0.0801, load, 11.0, 9.0, 20.0, 9.0)
    slide, limits = move.slide(MODEL, 1e-3), move.limits(4)
    assert fastest(slide, limits, move.x, move.v, move.target_m)[0] == 9.0


@pytest.mark.parametrize("count", [4, 20])
def test_where_its_multipliers_have_their_signs_the_start_is_the_solution(count: int) -> None:
    settings = ApproachSettings(prediction_steps=count, control_steps=count)
    confirmed = 0
    for move, period_s in some_moves(100):
        slide, limits = move.slide(MODEL, period_s), move.limits(count)
        inputs = fastest(slide, limits, move.x, move.v, move.target_m)
        trajectory = predict(slide, count, move.x, move.v, move.target_m, inputs)
        posed = program(settings, limits, move.target_m, trajectory, inputs)
        found = np.array(multipliers(posed, limits, trajectory, inputs))
        made = dense(posed.program)
        assert np.all(found[count:] >= 0.0)
        lagrangian = made.P @ inputs + made.q + made.A.T @ found
        if np.abs(lagrangian).max() > 1e-6:
            continue
        confirmed += 1
        solution = QpSolver(count, count, tolerance=1e-9, max_iterations=100_000).solve(posed.program)
        assert solution == pytest.approx(inputs, abs=1e-3)
        plan = plan_move(settings, MODEL, QpSolver(count, count), move, period_s)
        assert plan.passes == 1
    assert confirmed > 30
