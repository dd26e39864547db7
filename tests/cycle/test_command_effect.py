"""Whether commands act: by the quality that a node reports, and by the command that its readings name."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from positioner.cycle.command_effect import EFFECT_UNKNOWN, CommandEffect, track_effect
from positioner.cycle.link import Reading
from positioner.cycle.sent import SentCommand
from positioner.wire.codec import make_codec
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
        sent = commands[max(0, number - 255) : number]
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
        acting = track_effect(acting, (SentCommand(number % 256, 10.0),), Reading(0.08, None, None, 1), FORM, PERIOD_S)
    assert (acting.fault, acting.teaches, acting.current_ma) == (None, True, 10.0)
