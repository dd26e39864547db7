"""Pushes that fail: how many, how seldom, and where they are reported, whatever the table holds."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from loop_helpers import Loop

from positioner.cycle.events import MoveBegan
from positioner.cycle.trust_events import PushFailed
from positioner.laws.correction import LEFT
from positioner.laws.law import Observation
from positioner.laws.pushes import MOST_FAILED, Pushes
from positioner.valve.parameters import ValveParameters
from positioner.valve.state import StemState
from positioner.valve.stiction import Direction, Quantity, StictionTable

VALVE = ValveParameters(id="paper")
JAMMED = {
    "preset": "paper",
    "valve": {"static_friction_n": 2e4, "coulomb_friction_n": 1.9e4, "initial_position_m": 0.08},
}


def gamma_table(share: float) -> StictionTable:
    """Return ten samples of Γ in each cell from 65 to 95 mm, of a valve with `share` of the static friction."""
    table = StictionTable(0.005)
    for _ in range(10):
        for index in range(13, 20):
            for direction in Direction:
                static_n = direction.sign * share * VALVE.static_friction_n
                gamma_ma = (VALVE.spring_rate_n_per_m * index * 0.005 + static_n) / VALVE.force_gain_n_per_ma
                table = table.record(Quantity.BREAKAWAY_CURRENT, index * 0.005, direction, gamma_ma)
    return table


@pytest.mark.parametrize("share", [0.3, 0.6, 0.8])
def test_a_table_that_is_too_weak_costs_a_few_pushes_in_a_dwell(share: float) -> None:
    # friction that scatters by 10 % at each stop; without the floor it takes 200 to 300 pushes
    loop = Loop("nmpc", gamma_table(share), seed=1, plant={"preset": "stochastic"})
    errors_m = []
    for setpoint_m in (0.073, 0.087, 0.08, 0.079):
        moves = sum(isinstance(event, MoveBegan) for event in loop.run(1.0, setpoint_m))
        assert 1 <= moves <= 8
        errors_m.append(abs(loop.position_m - setpoint_m))
    assert max(errors_m) < LEFT * VALVE.span_m


def test_nmpc_tries_a_jammed_stem_ever_more_seldom_and_finds_it_free_again() -> None:
    loop = Loop("nmpc", plant=JAMMED, sample_period_s=0.005, setpoint_period_s=0.01)
    loop.run(0.5, 0.08)
    failed_s = [
        0.1 * tenth for tenth in range(300) if any(isinstance(event, PushFailed) for event in loop.run(0.1, 0.087))
    ]
    assert 12 <= len(failed_s) <= 40
    assert max(after - before for before, after in pairwise(failed_s)) > 2.0
    free = Loop("nmpc", plant={"preset": "paper", "valve": {"initial_position_m": 0.08}})
    loop.plant = free.plant
    loop.device = replace(loop.device, plant=replace(free.device.plant, time_s=loop.device.plant.time_s))
    loop.run(90.0, 0.087)
    assert loop.position_m == pytest.approx(0.087, abs=1e-3)


def test_a_breakaway_of_the_papers_law_fails_twenty_times_at_most() -> None:
    # by its own estimate; the plan goes on, as in the paper's controller
    law, table, released = Loop("paper").setup.law, gamma_table(1.0), 0
    memory, stem = law.begin(0.08), StemState(0.08, 0.0, stuck=True, direction=1.0)
    rests = []
    for sample in range(400):
        seen = Observation(0.08, 12.6, 0.001, 0.087, 0.001 * sample)
        memory, decision = law.decide(memory, stem, seen, table)
        released += decision.bounds.current_low_ma > 4.0
        rests += [decision.rest_s] if decision.failed_pushes else []
    assert released == MOST_FAILED
    assert rests == [0.0] * (MOST_FAILED - 1) + [1.0]


@given(st.lists(st.tuples(st.floats(0.0, 10.0), st.floats(-5e-4, 5e-4)), min_size=1, max_size=200))
def test_pushes_that_fail_are_bounded_in_any_time_for_one_setpoint(waits: list[tuple[float, float]]) -> None:
    pushes, now_s, made = Pushes().for_setpoint(0.08, 0.127), 0.0, 0
    for wait_s, tremble_m in waits:
        now_s += wait_s
        pushes = pushes.for_setpoint(0.08 + tremble_m, 0.127)
        if pushes.may_push(now_s):
            made += 1
            pushes = pushes.after_push(moved=False, time_s=now_s, rest_m=0.08, sigma_m=1e-5)
    # 1 + 2 + 4 + ... + 32 s, then a minute each
    bound = MOST_FAILED + sum(1 for k in range(6) if 2.0**k - 1.0 <= now_s) + int(now_s / 60.0)
    assert made <= bound
    assert pushes.failed == made
