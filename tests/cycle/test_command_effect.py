"""Whether commands act: by the quality that a node reports, and by the command that its readings name."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from positioner.cycle.command_effect import EFFECT_UNKNOWN, CommandEffect, track_effect
from positioner.cycle.link import Reading
from positioner.cycle.sent import SentCommand, SentCommands
from positioner.wire.codec import make_codec
from positioner.wire.formats import FrameFormat
from positioner.wire.messages import Cause, CurrentCommand

if TYPE_CHECKING:
    from collections.abc import Iterator


CODEC = make_codec()
FORM = CODEC.by_kind[CurrentCommand]
PERIOD_S = 0.001


def effects_after(echoes: Iterator[tuple[int, bool]], readings: int) -> list[CommandEffect]:
    """Return the effect after each reading; the k-th one follows command k - 1 and has the k-th of `echoes`."""
    acting, found = EFFECT_UNKNOWN, []
    commands = tuple(SentCommand(k % 256, 10.0 + 0.001 * k) for k in range(readings))
    for number in range(readings):
        sent = SentCommands(newest=commands[max(0, number - 255) : number])
        echo, obeys = next(echoes)
        acting = track_effect(acting, sent, Reading(0.08, number % 256, echo % 256, 1, obeys), FORM, PERIOD_S)
        found.append(acting)
    return found


@given(st.integers(1, 100))
def test_an_echo_may_lag_as_long_as_it_advances(lag: int) -> None:
    found = effects_after(((max(k - lag, 0), True) for k in range(10_000)), 1000)
    assert [each.fault for each in found[lag + 1 :]] == [None] * (999 - lag)
    assert all(each.teaches for each in found[lag + 110 :])
    assert [each.current_ma for each in found[lag + 1 :]] == [
        pytest.approx(10.0 + 0.001 * (k - lag)) for k in range(lag + 1, 1000)
    ]


@given(st.integers(0, 255), st.booleans())
def test_an_echo_that_stays_is_reported_after_a_tenth_of_a_second_however_often_the_counter_wraps(
    stuck: int, starts_well: bool
) -> None:
    good = 300 if starts_well else 1
    found = effects_after(((k - 1 if k < good else stuck, True) for k in range(10_000)), good + 1000)
    faults = [each.fault for each in found]
    first = faults.index(Cause.COMMAND_IGNORED)
    assert good + 98 <= first <= good + 102
    assert set(faults[first:]) == {Cause.COMMAND_IGNORED}
    assert not any(each.teaches for each in found[good + 3 :])


def test_a_node_that_reports_a_failure_is_believed_sooner_and_its_first_reading_not_at_all() -> None:
    # before its first command a node obeys none; then it does, and after 500 readings it fails for 50
    found = effects_after(((k - 1, k > 0 and not 500 <= k < 550) for k in range(10_000)), 700)
    assert {each.fault for each in found[:500]} == {None}
    assert all(each.teaches for each in found[:500])
    assert not any(each.teaches for each in found[500:648])
    assert [each.fault for each in found[500:550]] == [None] * 19 + [Cause.ACTUATOR_FAILED] * 31
    assert {each.fault for each in found[550:]} == {None}
    assert found[-1].teaches


def test_what_was_never_sent_and_an_older_command_are_no_sign_of_obedience() -> None:
    found = effects_after(((200 if k % 2 else 0, True) for k in range(10_000)), 150)
    assert found[-1].fault is Cause.COMMAND_IGNORED
    backwards = effects_after(((149 - k, True) for k in range(10_000)), 190)
    assert backwards[-1].fault is Cause.COMMAND_IGNORED


def test_a_node_without_an_echo_is_believed_to_obey() -> None:
    acting = EFFECT_UNKNOWN
    for number in range(1000):
        sent = SentCommands(newest=(SentCommand(number % 256, 10.0),))
        acting = track_effect(acting, sent, Reading(0.08, None, None, 1), FORM, PERIOD_S)
    assert (acting.fault, acting.teaches, acting.current_ma) == (None, True, 10.0)


# one reading at a time


SENT = SentCommands(newest=(SentCommand(3, 10.0), SentCommand(4, 11.0), SentCommand(5, 12.0)))


def effect(before: CommandEffect, named: int | None, *, obeys: bool = True) -> CommandEffect:
    return track_effect(before, SENT, Reading(0.08, 1, named, 1, obeys), FORM, PERIOD_S)


def test_the_named_command_is_kept_with_its_current_until_a_newer_one_is_named() -> None:
    first = effect(EFFECT_UNKNOWN, 4)
    assert first == CommandEffect(named=4, echo=4, echo_ma=11.0, current_ma=11.0)
    same = effect(first, 4)
    assert same == CommandEffect(named=4, echo=4, echo_ma=11.0, current_ma=11.0, idle_cycles=1, idle_s=PERIOD_S)
    unknown = effect(same, 99)  # never sent: the last command is the best guess
    assert unknown == CommandEffect(named=99, echo=4, echo_ma=11.0, current_ma=12.0, idle_cycles=2, idle_s=2 * PERIOD_S)
    newer = effect(unknown, 5)
    assert newer == CommandEffect(named=5, echo=5, echo_ma=12.0, current_ma=12.0)


def test_of_a_node_without_counters_the_last_command_is_believed_to_act() -> None:
    form = FrameFormat(FORM.kind, FORM.dbc, FORM.arbitration_id, FORM.fields, FORM.data_id, None)
    found = track_effect(EFFECT_UNKNOWN, SENT, Reading(0.08, 1, 4, 1), form, PERIOD_S)
    assert found == CommandEffect(current_ma=12.0, echo_ma=12.0)


@pytest.mark.parametrize(("step", "newer"), [(1, True), (127, True), (128, True), (129, False), (255, False)])
def test_a_command_is_newer_up_to_half_of_the_counters_range(step: int, newer: bool) -> None:
    before = CommandEffect(named=0, echo=0, echo_ma=9.0, current_ma=9.0)
    sent = SentCommands(newest=(SentCommand(0, 9.0), SentCommand(step, 13.0)))
    found = track_effect(before, sent, Reading(0.08, 1, step, 1), FORM, PERIOD_S)
    assert (found.idle_cycles == 0) is newer
    assert found.current_ma == 13.0
