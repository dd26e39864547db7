"""Nothing is learned while commands do not act, it is told, and the law begins anew when they act again."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st
from loop_helpers import Loop, passed

from positioner.acting import NOTHING_KNOWN, Acting, Sent, heed
from positioner.events import ForeignCommand, Learned, ModeChanged
from positioner.laws.registry import LAWS
from positioner.link import Reading
from positioner.trust_events import ActingChanged
from positioner.wire.codec import make_codec
from positioner.wire.messages import Cause, CurrentCommand, Health, Mode, Quality, StemPosition

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.wire.messages import CanFrame

CODEC = make_codec()
FORM = CODEC.by_kind[CurrentCommand]
PERIOD_S = 0.001


def played(echoes: Iterator[tuple[int, bool]], readings: int) -> list[Acting]:
    """What is known after each reading; the k-th one follows command k - 1, names that many, and says if it obeys."""
    acting, found = NOTHING_KNOWN, []
    for number in range(readings):
        sent = tuple(Sent(k % 256, 10.0 + 0.001 * k) for k in range(max(0, number - 255), number))
        echo, obeys = next(echoes)
        acting = heed(acting, sent, Reading(0.08, number % 256, echo % 256, 1, obeys), FORM, PERIOD_S)
        found.append(acting)
    return found


@given(st.integers(1, 100))
def test_an_echo_may_lag_as_long_as_it_comes_on(lag: int) -> None:
    found = played(((max(k - lag, 0), True) for k in range(10_000)), 1000)
    assert [each.fault for each in found[lag + 1 :]] == [None] * (999 - lag)
    assert all(each.teaches for each in found[lag + 110 :])
    assert [each.current_ma for each in found[lag + 1 :]] == [
        pytest.approx(10.0 + 0.001 * (k - lag)) for k in range(lag + 1, 1000)
    ]


@given(st.integers(0, 255), st.booleans())
def test_an_echo_that_stays_is_told_after_a_tenth_of_a_second_however_often_the_counter_goes_round(
    stuck: int, starts_well: bool
) -> None:
    good = 300 if starts_well else 1
    found = played(((k - 1 if k < good else stuck, True) for k in range(10_000)), good + 1000)
    faults = [each.fault for each in found]
    first = faults.index(Cause.COMMAND_IGNORED)
    assert good + 98 <= first <= good + 102
    assert set(faults[first:]) == {Cause.COMMAND_IGNORED}
    assert not any(each.teaches for each in found[good + 3 :])


def test_a_node_that_says_so_is_believed_sooner_and_its_first_reading_not_at_all() -> None:
    # before its first command a node obeys none; then it does, and after 500 readings it fails for 50
    found = played(((k - 1, k > 0 and not 500 <= k < 550) for k in range(10_000)), 700)
    assert {each.fault for each in found[:500]} == {None}
    assert all(each.teaches for each in found[:500])
    assert not any(each.teaches for each in found[500:648])
    assert [each.fault for each in found[500:550]] == [None] * 19 + [Cause.ACTUATOR_FAILED] * 31
    assert {each.fault for each in found[550:]} == {None}
    assert found[-1].teaches


def test_what_was_never_sent_and_an_older_command_are_no_sign_of_obedience() -> None:
    found = played(((200 if k % 2 else 0, True) for k in range(10_000)), 150)
    assert found[-1].fault is Cause.COMMAND_IGNORED
    backwards = played(((149 - k, True) for k in range(10_000)), 190)
    assert backwards[-1].fault is Cause.COMMAND_IGNORED


def test_a_node_without_an_echo_is_believed_to_obey() -> None:
    acting = NOTHING_KNOWN
    for number in range(1000):
        acting = heed(acting, (Sent(number % 256, 10.0),), Reading(0.08, None, None, 1), FORM, PERIOD_S)
    assert (acting.fault, acting.teaches, acting.current_ma) == (None, True, 10.0)


class Deaf:
    """A node that takes no command from now on, and says so, or only goes on naming the last one that it took."""

    def __init__(self, loop: Loop, *, says_so: bool) -> None:
        self.loop, self.says_so, self.echo = loop, says_so, loop.device.command_counter

    def to_plant(self, frames: tuple[CanFrame, ...]) -> tuple[CanFrame, ...]:
        del frames
        return ()

    def to_positioner(self, frames: tuple[CanFrame, ...]) -> tuple[CanFrame, ...]:
        return tuple(self.told(frame) for frame in frames)

    def told(self, frame: CanFrame) -> CanFrame:
        message, counter = self.loop.codec.decode(frame)
        if not isinstance(message, StemPosition):
            return frame
        quality = Quality.FAIL_POSITION if self.says_so else Quality.VALID
        return self.loop.codec.encode(StemPosition(message.position_m, self.echo, quality), counter or 0)


class Usurper:
    """Another controller whose commands act in the place of ours, 10 mA each."""

    def __init__(self, loop: Loop) -> None:
        self.loop, self.counter = loop, loop.device.command_counter

    def to_plant(self, frames: tuple[CanFrame, ...]) -> tuple[CanFrame, ...]:
        del frames
        return (self.loop.codec.encode(CurrentCommand(10.0), self.counter),)

    def to_positioner(self, frames: tuple[CanFrame, ...]) -> tuple[CanFrame, ...]:
        self.counter += 1
        return (*frames, *self.to_plant(()))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", ["failed", "deaf", "usurped"])
def test_a_law_learns_nothing_while_its_commands_do_not_act_and_begins_anew_after(law: str, kind: str) -> None:
    loop = Loop(law)
    loop.run(0.3, 0.08)
    fault = Usurper(loop) if kind == "usurped" else Deaf(loop, says_so=kind == "failed")
    cause = {"failed": Cause.ACTUATOR_FAILED, "deaf": Cause.COMMAND_IGNORED, "usurped": Cause.FOREIGN_COMMAND}[kind]
    loop.to_plant, loop.to_positioner = fault.to_plant, fault.to_positioner
    loop.run(0.005, 0.08)
    table = loop.state.table
    events = [event for setpoint_m in (0.073, 0.087, 0.08) for event in loop.run(0.2, setpoint_m)]
    assert loop.state.table is table
    assert not any(isinstance(event, Learned) for event in events)
    guard = loop.state.guard
    assert (guard.mode, guard.cause, guard.health(table_saved=True)) == (Mode.ACTIVE, cause, Health.FAILURE)
    told = loop.told(ForeignCommand if kind == "usurped" else ActingChanged)
    assert told
    wrong = loop.state.memory
    loop.to_plant = loop.to_positioner = passed
    events = loop.run(1.2, 0.08)
    assert loop.state.guard.cause is Cause.NONE
    assert any(isinstance(event, ModeChanged) and event.cause is Cause.NONE for event in events)
    if kind != "usurped":
        causes = [event.cause for event in loop.told(ActingChanged)]
        assert (causes[0], causes[-1]) == (cause, None)
    if law == "nmpc":
        # what was believed of the load while nothing acted is forgotten
        assert loop.state.memory.watch.ratio < 1.2 * 1.03**3
        assert loop.position_m == pytest.approx(0.08, abs=1e-3)
        assert wrong is not loop.state.memory
