"""While the commands of a law do not act, it learns nothing; when they act again, it starts again."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from loop_helpers import Loop, passed
from slow_cases import slow

from positioner.cycle.events import ForeignCommand, Learned, ModeChanged
from positioner.cycle.trust_events import ActingChanged
from positioner.laws.nmpc.belief import STATIC
from positioner.laws.registry import LAWS
from positioner.wire.messages import Cause, CurrentCommand, Health, Mode, Quality, StemPosition

if TYPE_CHECKING:
    from positioner.laws.law import Law
    from positioner.wire.messages import CanFrame


class IgnoringNode:
    """A node that ignores every command from now on, and reports FAIL_POSITION, or only an old counter."""

    def __init__(self, loop: Loop, *, reports_it: bool) -> None:
        self.loop, self.reports_it, self.echo = loop, reports_it, loop.device.command_counter

    def to_plant(self, frames: tuple[CanFrame, ...]) -> tuple[CanFrame, ...]:
        del frames
        return ()

    def to_positioner(self, frames: tuple[CanFrame, ...]) -> tuple[CanFrame, ...]:
        return tuple(self.with_old_echo(frame) for frame in frames)

    def with_old_echo(self, frame: CanFrame) -> CanFrame:
        message, counter = self.loop.codec.decode(frame)
        if not isinstance(message, StemPosition):
            return frame
        quality = Quality.FAIL_POSITION if self.reports_it else Quality.VALID
        return self.loop.codec.encode(StemPosition(message.position_m, self.echo, quality), counter or 0)


class OtherController:
    """Another controller whose commands act in the place of ours, 10 mA each."""

    def __init__(self, loop: Loop) -> None:
        self.loop, self.counter = loop, loop.device.command_counter

    def to_plant(self, frames: tuple[CanFrame, ...]) -> tuple[CanFrame, ...]:
        del frames
        return (self.loop.codec.encode(CurrentCommand(10.0), self.counter),)

    def to_positioner(self, frames: tuple[CanFrame, ...]) -> tuple[CanFrame, ...]:
        self.counter += 1
        return (*frames, *self.to_plant(()))


class Counting:
    """A law that counts its starts."""

    def __init__(self, law: Law[Any]) -> None:
        self.law, self.name, self.begun = law, law.name, 0
        self.estimate, self.decide = law.estimate, law.decide

    def begin(self, measured_m: float) -> Any:
        self.begun += 1
        return self.law.begin(measured_m)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", ["failed", *slow("ignored", "replaced")])
def test_a_law_learns_nothing_while_its_commands_do_not_act_and_begins_anew_after(law: str, kind: str) -> None:
    loop = Loop(law)
    counting = Counting(loop.setup.law)
    loop.setup = replace(loop.setup, law=counting)
    # a foreign command within a second of the arming is another matter: one ARM has armed two
    loop.run(1.1 if kind == "replaced" else 0.3, 0.08)
    fault = OtherController(loop) if kind == "replaced" else IgnoringNode(loop, reports_it=kind == "failed")
    cause = {"failed": Cause.ACTUATOR_FAILED, "ignored": Cause.COMMAND_IGNORED, "replaced": Cause.FOREIGN_COMMAND}[kind]
    loop.to_plant, loop.to_positioner = fault.to_plant, fault.to_positioner
    loop.run(0.005, 0.08)
    table = loop.state.table
    events = [event for setpoint_m in (0.073, 0.087, 0.08) for event in loop.run(0.2, setpoint_m)]
    assert loop.state.table is table
    assert not any(isinstance(event, Learned) for event in events)
    guard = loop.state.guard
    assert (guard.mode, guard.cause, guard.health(table_saved=True)) == (Mode.ACTIVE, cause, Health.FAILURE)
    events = loop.events_of(ForeignCommand if kind == "replaced" else ActingChanged)
    assert events
    assert counting.begun == 1
    loop.to_plant = loop.to_positioner = passed
    events = loop.run(1.2, 0.08)
    # with the stem far away, moves that were no moves may have failed meanwhile
    assert loop.state.guard.cause in {Cause.NONE, Cause.VALVE_DIFFERS}
    assert counting.begun == 2
    assert any(isinstance(event, ModeChanged) and event.cause is Cause.NONE for event in events)
    if kind != "replaced":
        causes = [event.cause for event in loop.events_of(ActingChanged)]
        assert (causes[0], causes[-1]) == (cause, None)
    if law == "nmpc":
        # what was believed in the time without effect is deleted
        belief = loop.state.control.memory.belief
        assert belief.static_ma < 1.2 * belief.configured[STATIC]
        assert loop.position_m == pytest.approx(0.08, abs=1e-3)
