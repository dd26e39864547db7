"""Which requests arm, which disarm, and what an arming keeps of the guard's state."""

from __future__ import annotations

from dataclasses import replace

import pytest

from positioner.guard.arming import DOUBLE_ARMING_NS, _latest_request, arm
from positioner.guard.manual import Manual, is_fresh
from positioner.guard.settings import GuardSettings
from positioner.guard.state import Arming, Conditions, GuardInput, GuardState, LastReceived, LawRecord
from positioner.guard.supervisor import supervise
from positioner.wire.messages import Cause, HostRequest, Mode

SETTINGS = GuardSettings()
PERIOD_S = 0.001
SECOND = 1_000_000_000
ASKED = GuardInput(feedback_age_ns=0, setpoint_age_ns=0, requests=(HostRequest.ARM,))
READY = GuardState(mode=Mode.READY, arming=Arming(request=HostRequest.NONE), last=LastReceived(feedback_ns=0))
ARMED = replace(
    READY,
    mode=Mode.ACTIVE,
    arming=Arming(armed=True, ever_armed=True, request=HostRequest.ARM, armed_or_returned_ns=0),
)


def supervised(
    state: GuardState, guard_input: GuardInput, now_ns: int, conditions: Conditions | None = None
) -> GuardState:
    return supervise(SETTINGS, state, guard_input, PERIOD_S, now_ns, conditions or Conditions())


def test_arming_keeps_what_is_wrong_besides_missing_data() -> None:
    armed = supervised(READY, ASKED, SECOND, Conditions(period_wrong=True))
    assert (armed.mode, armed.cause) == (Mode.ACTIVE, Cause.PERIOD_WRONG)
    assert armed.conditions == Conditions(period_wrong=True)


def test_arming_forgets_the_failures_and_late_answers_of_the_law_and_keeps_its_late_cycles() -> None:
    failed = replace(READY, law=LawRecord(failures=10, late_cycles=10, late_answers=10))
    armed = supervised(failed, ASKED, SECOND, Conditions(late=True))
    assert armed.law == LawRecord(failures=0, late_cycles=11, late_answers=0)
    assert (armed.mode, armed.cause) == (Mode.ACTIVE, Cause.LAW_LATE)


def test_an_arm_that_waited_for_too_long_is_in_force_and_its_repetition_does_not_arm() -> None:
    waited = supervised(READY, GuardInput(feedback_age_ns=0, waiting_request=HostRequest.ARM), SECOND)
    assert waited.arming == Arming(request=HostRequest.ARM)
    assert not supervised(waited, ASKED, SECOND).arming.armed
    fresh = supervised(waited, replace(ASKED, requests=(HostRequest.NONE, HostRequest.ARM)), SECOND)
    assert fresh.arming.armed


@pytest.mark.parametrize("age_ns", [0, DOUBLE_ARMING_NS, DOUBLE_ARMING_NS + 1])
def test_a_foreign_command_soon_after_the_arming_or_after_one_like_ours_disarms(age_ns: int) -> None:
    foreign = GuardInput(feedback_age_ns=0, setpoint_age_ns=0, foreign_command=True)
    returned = supervised(ARMED, replace(foreign, foreign_command=False, own_command_returned=True), 5 * SECOND)
    assert returned.arming == replace(ARMED.arming, armed_or_returned_ns=5 * SECOND)
    for state, then_ns in ((ARMED, 0), (returned, 5 * SECOND)):
        after = supervised(state, foreign, then_ns + age_ns)
        assert after.arming.armed is (age_ns > DOUBLE_ARMING_NS)
        assert after.arming.request is HostRequest.ARM


def test_the_newest_request_is_in_force_and_only_a_change_to_arm_asks_for_it() -> None:
    none, arm_, disarm = HostRequest.NONE, HostRequest.ARM, HostRequest.DISARM
    for before, requests, expected in (
        (None, (), (None, False)),
        (None, (arm_,), (None, False)),
        (None, (none, arm_), (arm_, True)),
        (none, (arm_,), (arm_, True)),
        (arm_, (arm_,), (arm_, False)),
        (arm_, (none,), (none, False)),
        (disarm, (arm_, none), (none, True)),
    ):
        assert _latest_request(before, requests, fresh=True) == expected
        assert _latest_request(before, requests, fresh=False)[1] is False


@pytest.mark.parametrize(
    ("hold_s", "age_ns", "expected"),
    [(0.0, 60 * SECOND, True), (1.0, SECOND, True), (1.0, SECOND + 1, False), (0.5, SECOND // 2, True)],
)
def test_a_current_by_hand_is_fresh_for_as_long_as_a_setpoint_and_for_ever_without_that_limit(
    hold_s: float, age_ns: int, expected: bool
) -> None:
    settings = replace(SETTINGS, setpoint_hold_s=hold_s)
    assert is_fresh(settings, Manual(9.0, SECOND), SECOND + age_ns) is expected
    assert not is_fresh(settings, Manual(), SECOND)


def test_a_positioner_that_is_armed_is_not_armed_again() -> None:
    again = replace(ASKED, requests=(HostRequest.NONE, HostRequest.ARM))
    assert arm(SETTINGS, ARMED, again, SECOND, 5).arming == ARMED.arming
