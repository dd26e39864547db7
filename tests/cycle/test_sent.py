"""The commands that were sent, beside a plain list of them."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from positioner.cycle.sent import NONE_SENT, SentCommand


@given(st.lists(st.integers(-2, 40), max_size=40), st.sampled_from([2, 4, 16, 100, 256, 65_536]))
def test_they_are_the_newest_ones_and_each_counter_names_one(steps: list[int], modulus: int) -> None:
    commands, expected, number = NONE_SENT, list[SentCommand](), 0
    for step in steps:
        for _ in range(-step):  # the last ones were not sent
            commands, expected = commands.without_newest(), expected[:-1]
        for _ in range(abs(step)):
            command = SentCommand(number % modulus, 4.0 + number)
            commands, expected, number = commands.with_newest(command), [*expected, command], number + 1

        assert commands.last == (expected[-1] if expected else None)
        remembered = {each.counter: each for each in expected[-min(255, modulus - 1) :]}
        for counter in range(min(modulus, number + 1)):
            assert commands.named(counter, modulus) == remembered.get(counter)


def test_no_more_of_them_are_kept_than_can_be_named() -> None:
    commands = NONE_SENT
    for number in range(1000):
        commands = commands.with_newest(SentCommand(number % 256, 4.0))
    assert 255 <= len(commands.newest) + sum(len(each) for each in commands.full) < 255 + 18


def test_a_command_that_was_not_sent_is_taken_from_a_full_tuple_too() -> None:
    commands = NONE_SENT
    for number in range(17):
        commands = commands.with_newest(SentCommand(number, 4.0))
    fifteen = commands.without_newest().without_newest()
    assert fifteen.last == SentCommand(14, 4.0)
    assert fifteen.named(15, 256) is None
