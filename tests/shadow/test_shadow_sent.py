"""What a law in the shadow believes of the pressure: that of the current that was sent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from positioner.config.reader import parse_config
from positioner.laws.law import Observation
from positioner.shadow.sent import at_new_setpoint, with_sent
from positioner.values import replace
from positioner.valve.stiction import StictionTable

TEXT = '[valve]\nid = "v"\npreset = "paper"\n[control]\nlaw = "{}"\n'
HERE_M, THERE_M = 0.06, 0.08


def law_of(name: str) -> Any:
    return parse_config(TEXT.format(name), "test", Path()).make_law()


def observed(applied_ma: float, setpoint_m: float = HERE_M) -> Observation:
    return Observation(HERE_M, applied_ma, 0.001, setpoint_m, 0.0)


def moving(law: Any, setpoint_m: float = THERE_M) -> Any:
    """Return the memory of a law that has begun a move of its own, 9 mA below its current."""
    memory, table = law.begin(HERE_M), StictionTable()
    for _ in range(100):
        memory, estimate = law.estimate(memory, observed(9.0, setpoint_m))
        memory, decision = law.decide(memory, estimate.stem, observed(9.0, setpoint_m), table)
        if decision.reason is not None:
            return memory
    raise AssertionError


def test_the_pressure_is_that_of_the_current_that_was_sent() -> None:
    law = law_of("quasi-static")
    memory = moving(law)
    assert memory.sent_ma > 10.0
    obeyed, _ = law.estimate(memory, observed(9.0))
    assert obeyed.pressure.pressure_ma == pytest.approx(memory.sent_ma)  # the paper's valve has no lag
    in_the_shadow, _ = law.estimate(with_sent(memory, 9.0), observed(9.0))
    assert in_the_shadow.pressure.pressure_ma == pytest.approx(9.0)


def test_a_law_without_such_a_belief_and_a_cycle_without_a_command_change_nothing() -> None:
    memory = moving(law_of("quasi-static"))
    assert with_sent(memory, None) is memory
    assert with_sent(memory, memory.sent_ma) is memory
    pi = law_of("pi").begin(HERE_M)
    assert with_sent(pi, 9.0) is pi
    assert at_new_setpoint(law_of("pi"), pi, HERE_M) is pi


def test_a_move_that_was_not_made_is_given_up_with_what_was_learned() -> None:
    law = law_of("quasi-static")
    begun = moving(law)
    memory = replace(begun, belief=begun.belief.with_lag(0.02))
    given_up = at_new_setpoint(law, memory, HERE_M)
    assert memory.move.stage is not None
    assert given_up.move.stage is None
    assert given_up.belief == memory.belief
    assert at_new_setpoint(law, given_up, HERE_M) is given_up
    assert at_new_setpoint(law, memory, None) is memory
