"""Commands that act one or two samples late: the plan begins where the stem will be when its command acts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from test_law_nmpc import PERIOD_S, make_law, rested

from positioner.cycle.command_effect import CommandEffect
from positioner.cycle.control import _pending_ma
from positioner.cycle.sent import OutputState, SentCommand
from positioner.cycle.state import CycleState
from positioner.laws.law import Decision, Observation
from positioner.laws.nmpc.filter import Sliding
from positioner.laws.nmpc.late_commands import ahead, pending_ma
from positioner.laws.nmpc.memory import Lateness, NmpcMemory
from positioner.values import replace
from positioner.valve.stiction import StictionTable
from positioner.wire.messages import Motion

if TYPE_CHECKING:
    from positioner.laws.nmpc.law import NmpcLaw


def cycle(
    law: NmpcLaw, memory: NmpcMemory, applied_ma: float, pending: tuple[float, ...], setpoint_m: float
) -> tuple[NmpcMemory, Decision]:
    seen = Observation(0.08, applied_ma, PERIOD_S, setpoint_m, 1.0, pending_ma=pending)
    memory, estimate = law.estimate(memory, seen)
    return law.decide(memory, estimate.stem, seen, StictionTable())


def test_a_number_of_pending_commands_counts_once_it_is_no_accident() -> None:
    lateness = Lateness()
    for late, expected in ((1, 0), (1, 0), (0, 0), (1, 0), (1, 0), (1, 1), (2, 1), (1, 1), (0, 1), (0, 1), (0, 0)):
        lateness = lateness.followed_by(late)
        assert lateness.samples == expected


def test_the_stem_is_planned_for_where_the_pending_commands_take_it() -> None:
    law = make_law()
    memory = replace(rested(law), lateness=Lateness(2))
    stem = memory.stem
    assert not isinstance(stem, Sliding)
    sliding = law.filter.depart(stem, 1.0, 1.0)
    seen = Observation(0.08, 12.6, PERIOD_S, 0.085, 1.0, pending_ma=(19.0, 18.5, 4.0))
    assert pending_ma(memory, seen) == (19.0, 18.5)
    soon = ahead(law.filter, memory, sliding, seen, PERIOD_S)
    first = law.filter.model.step(sliding.x, 0.0, 19.0, sliding.load, 1.0, PERIOD_S)
    second = law.filter.model.step(first.x, first.v, 18.5, sliding.load, 1.0, PERIOD_S)
    assert (soon.x, soon.v, soon.stopped) == (second.x, second.v, False)
    # the current of the rest does not move the stem, and a push after it does
    late = ahead(law.filter, memory, sliding, replace(seen, pending_ma=(12.6, 19.0)), PERIOD_S)
    assert (late.x, late.v, late.stopped) == (first.x, first.v, False)
    # braking in the stick band stops it
    ends = ahead(law.filter, memory, replace(sliding, v=1e-3), replace(seen, pending_ma=(11.0, 12.0)), PERIOD_S)
    assert ends.stopped
    assert ends.v == 0.0


def test_a_push_that_is_pending_has_begun_and_the_plan_goes_on() -> None:
    law = make_law()
    resting = replace(rested(law), lateness=Lateness(1))
    hold_ma = resting.hold_ma or 0.0
    memory, push = cycle(law, resting, hold_ma, (hold_ma,), 0.09)
    assert push.motion is Motion.MOVE
    memory, second = cycle(law, memory, hold_ma, (push.current_ma,), 0.09)
    assert second.motion is Motion.MOVE
    # no second push: the plan of a stem that is free by then, not of one that sticks
    assert second.reason is None
    assert memory.corrections == 1
    assert isinstance(memory.stem, Sliding)
    assert memory.stem.v == 0.0
    # a push that got lost begins again
    memory, again = cycle(law, replace(memory, lateness=Lateness()), hold_ma, (), 0.09)
    assert again.reason is not None
    assert memory.corrections == 1


@pytest.mark.parametrize(("echo", "expected"), [(7, ()), (6, (13.0,)), (5, (12.0, 13.0)), (99, ()), (None, ())])
def test_the_commands_after_the_one_that_the_reading_names_are_pending(
    echo: int | None, expected: tuple[float, ...]
) -> None:
    sent = tuple(SentCommand(counter, ma) for counter, ma in ((4, 10.0), (5, 11.0), (6, 12.0), (7, 13.0)))
    state = CycleState(table=StictionTable())
    state.effect, state.output = CommandEffect(echo=echo), OutputState(sent=sent)
    assert _pending_ma(state) == expected


def test_the_first_command_of_all_has_not_freed_the_stem_while_another_current_acts() -> None:
    law = make_law()
    memory = replace(rested(law), hold_ma=None)
    memory, push = cycle(law, memory, 12.6, (), 0.09)
    assert push.motion is Motion.MOVE
    late, again = cycle(law, memory, 12.6, (push.current_ma,), 0.09)
    assert again.reason is not None
    assert late.corrections == 1
    memory, second = cycle(law, memory, push.current_ma, (), 0.09)
    assert second.reason is None
    assert isinstance(memory.stem, Sliding)
    assert memory.stem.v > 0.0
