"""The law `nmpc`: predictive moves while they converge, and where they do not, others that lead to the setpoint."""

from __future__ import annotations

from typing import Any

import pytest
from loop_helpers import Loop
from test_law_pushes import JAMMED

from positioner.cycle.events import Controlled, LawFellBack
from positioner.cycle.trust_events import PushFailed
from positioner.laws.nmpc.converging import Acting, ConvergingMemory
from positioner.laws.pushes import MOST_FAILED
from positioner.wire.messages import Cause, Health, HostRequest, Mode

SETPOINTS_M = (0.073, 0.087, 0.08, 0.076, 0.077, 0.09)
LAGGED: dict[str, Any] = {"preset": "paper", "actuator": {"fill_time_constant_s": 0.1, "vent_time_constant_s": 0.1}}


def memory_of(loop: Loop) -> ConvergingMemory:
    memory = loop.state.control.memory
    assert isinstance(memory, ConvergingMemory)
    return memory


def taken_over(loop: Loop) -> list[str]:
    return [event.why for event in loop.events_of(LawFellBack) if "quasi-static moves take over" in event.why]


@pytest.mark.parametrize("preset", ["paper", "spring-20", "friction+20"])
def test_where_predictive_moves_converge_every_current_is_theirs(preset: str) -> None:
    loops = [Loop(law, plant={"preset": preset}) for law in ("nmpc-predictive", "nmpc")]
    for loop in loops:
        for setpoint_m in SETPOINTS_M:
            loop.run(0.6, setpoint_m)
    first, second = ([event.current_ma for event in loop.events_of(Controlled)] for loop in loops)
    assert len(first) > 3000
    assert first == second
    assert not taken_over(loops[1])


def test_behind_a_lag_that_nobody_has_told_quasi_static_moves_lead_to_the_setpoint() -> None:
    loop, errors_pct = Loop("nmpc", plant=LAGGED), list[float]()
    for setpoint_m in SETPOINTS_M:
        loop.run(4.0, setpoint_m)
        errors_pct.append(100.0 * abs(loop.position_m - setpoint_m) / 0.1397)
    assert taken_over(loop)
    assert max(errors_pct) < 1.0
    assert max(errors_pct[2:]) < 0.3


def test_a_valve_that_differs_from_its_configuration_is_out_of_specification() -> None:
    loop = Loop("nmpc", plant=LAGGED)
    loop.run(4.0, 0.073)
    loop.run(4.0, 0.087)
    guard = loop.state.guard
    assert (guard.mode, guard.cause) == (Mode.ACTIVE, Cause.VALVE_DIFFERS)
    assert guard.health(table_saved=True) is Health.OUT_OF_SPECIFICATION
    loop.run(0.05, 0.087, HostRequest.DISARM)
    assert not loop.state.differs


def test_after_some_setpoints_the_predictive_law_is_tried_again_and_after_a_second_failure_later() -> None:
    loop = Loop("nmpc", plant=LAGGED)
    pauses = []
    for number in range(16):
        loop.run(3.0, SETPOINTS_M[number % 2])
        pauses.append(memory_of(loop).pause)
    assert pauses[0] in {0, 4}
    told = sorted(set(pauses) - {0})
    assert told == [4, 8, 16][: len(told)]
    failures = taken_over(loop)
    assert 2 <= len(failures) == len(told)
    assert all(" % of span " in why for why in failures)


def test_a_stem_that_is_jammed_is_pushed_again_once_quasi_static_moves_have_not_freed_it() -> None:
    loop = Loop("nmpc", plant=JAMMED)
    loop.run(0.5, 0.08)
    loop.run(5.0, 0.087)
    assert memory_of(loop).acting is Acting.AGAIN
    failed = [event.failed for event in loop.events_of(PushFailed)]
    assert failed[-1] == max(failed) == MOST_FAILED + 1


def test_a_setpoint_out_of_reach_says_nothing_against_the_law() -> None:
    loop = Loop("nmpc")
    loop.run(0.6, 0.08)
    loop.run(3.0, 0.125)  # 20 mA open the valve to 99.9 mm
    assert memory_of(loop).pause == 0
    loop.run(0.5, 0.08)
    assert memory_of(loop).acting is Acting.PREDICTIVE
    assert loop.position_m == pytest.approx(0.08, abs=7e-4)
