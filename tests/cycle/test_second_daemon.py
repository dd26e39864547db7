"""Our own commands that come back, and those of a second daemon that sends the same ones."""

from __future__ import annotations

import pytest

from positioner.cycle.events import Event, ForeignCommand, FramesLost
from positioner.cycle.link import LinkState, Received
from positioner.cycle.second_daemon import NO_RETURNED_COMMANDS, ReturnedCommands, without_own_commands
from positioner.cycle.sent import OutputState, SentCommand, SentCommands
from positioner.guard.state import GuardInput
from positioner.wire.codec import make_codec
from positioner.wire.messages import CurrentCommand

CODEC = make_codec()
STEP_MA = CODEC.field(CurrentCommand, "current_ma").si_per_bit
LOST = FramesLost("StemPosition", count=2)
OUTPUT = OutputState(SentCommands(newest=(SentCommand(7, 12.0), SentCommand(8, 12.5))), command_counter=9)


def received(*commands: tuple[int, float]) -> Received:
    events: list[Event] = [LOST, *(ForeignCommand(current_ma, counter) for counter, current_ma in commands)]
    guard_input = GuardInput(foreign_command=bool(commands), feedback_age_ns=3)
    return Received(LinkState(), None, guard_input, tuple(events))


def without(
    *commands: tuple[int, float], output: OutputState = OUTPUT, before: ReturnedCommands = NO_RETURNED_COMMANDS
) -> tuple[Received, ReturnedCommands]:
    return without_own_commands(CODEC, received(*commands), output, before)


def test_without_commands_of_others_nothing_is_changed() -> None:
    batch = received()
    kept, returned = without_own_commands(CODEC, batch, OUTPUT, NO_RETURNED_COMMANDS)
    assert kept is batch
    assert returned == ReturnedCommands(excess=0.0, sent=9)


@pytest.mark.parametrize("command", [(7, 12.0), (8, 12.5), (8, 12.5 + 0.9 * STEP_MA), (8, 12.5 - 0.9 * STEP_MA)])
def test_a_command_like_one_of_ours_is_no_foreign_one(command: tuple[int, float]) -> None:
    kept, returned = without(command)
    assert kept.events == (LOST,)
    assert kept.guard_input == GuardInput(foreign_command=False, feedback_age_ns=3, own_command_returned=True)
    assert kept.link == LinkState()
    assert returned == ReturnedCommands(excess=1.0, sent=9)


@pytest.mark.parametrize(
    "command", [(6, 12.0), (7, 12.5), (8, 12.0), (8, 12.5 + 1.1 * STEP_MA), (8, 12.5 - 1.1 * STEP_MA)]
)
def test_a_command_with_another_counter_or_current_is_foreign(command: tuple[int, float]) -> None:
    kept, returned = without(command)
    assert kept.events == received(command).events
    assert kept.guard_input == GuardInput(foreign_command=True, feedback_age_ns=3)
    assert returned == ReturnedCommands(excess=0.0, sent=9)


def test_of_ours_and_a_foreign_command_only_the_foreign_one_stays() -> None:
    kept, returned = without((7, 12.0), (7, 15.0), (8, 12.5))
    assert kept.events == received((7, 15.0)).events
    assert kept.guard_input == GuardInput(foreign_command=True, feedback_age_ns=3, own_command_returned=True)
    assert returned == ReturnedCommands(excess=2.0, sent=9)


def test_the_excess_fades_by_three_for_four_commands_sent_and_is_never_negative() -> None:
    assert without(before=ReturnedCommands(excess=5.0, sent=5))[1] == ReturnedCommands(excess=2.0, sent=9)
    assert without((7, 12.0), before=ReturnedCommands(excess=5.0, sent=5))[1] == ReturnedCommands(excess=3.0, sent=9)
    assert without(before=ReturnedCommands(excess=2.0, sent=1))[1] == ReturnedCommands(excess=0.0, sent=9)


def test_a_pause_of_our_commands_forgets_the_excess() -> None:
    pause = OutputState(command_counter=9)
    kept, returned = without((7, 12.0), output=pause, before=ReturnedCommands(excess=11.0, sent=9))
    assert kept.guard_input == GuardInput(foreign_command=True, feedback_age_ns=3)
    assert returned == ReturnedCommands(excess=0.0, sent=9)


def test_twelve_more_than_a_bus_doubles_are_a_second_daemon() -> None:
    for excess, is_foreign in ((10.5, False), (11.0, True), (11.5, True)):
        kept, returned = without((7, 12.0), before=ReturnedCommands(excess=excess, sent=9))
        assert kept.guard_input == GuardInput(
            foreign_command=is_foreign, feedback_age_ns=3, own_command_returned=True
        ), excess
        assert kept.events == (received((7, 12.0)).events if is_foreign else (LOST,))
        assert returned.excess == excess + 1.0


@pytest.mark.parametrize(("every", "first"), [(1, 45), (2, None)])
def test_one_for_each_of_ours_is_a_second_daemon_after_45_and_every_second_never(every: int, first: int | None) -> None:
    found, before = None, NO_RETURNED_COMMANDS
    for number in range(1, 2000):
        output = OutputState(SentCommands(newest=(SentCommand(number % 256, 12.0),)), command_counter=number)
        commands = [(number % 256, 12.0)] if number % every == 0 else []
        kept, before = without(*commands, output=output, before=before)
        if found is None and kept.guard_input.foreign_command:
            found = number
    assert found == first
