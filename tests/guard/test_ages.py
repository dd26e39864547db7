"""How old a reading, a request and a command may be; closed forms of the guard's settings."""

from __future__ import annotations

from dataclasses import replace

import pytest

from positioner.guard.settings import GuardSettings
from positioner.guard.stall import Freshness, freshness, stall_of
from positioner.guard.state import (
    NOTHING_WRONG,
    Arming,
    Conditions,
    GuardInput,
    GuardState,
    LastReceived,
    LawRecord,
)
from positioner.guard.supervisor import deadline_ns, supervise
from positioner.wire.messages import CanFrame, Cause, HostRequest, Mode

SETTINGS = GuardSettings(feedback_hold_periods=3, feedback_failsafe_periods=10)
PERIOD_S = 0.01
MS = 1_000_000
HOLD_NS, FAILSAFE_NS = 30 * MS, 100 * MS
NOW_NS = 5_000 * MS


@pytest.mark.parametrize("gap_ns", [HOLD_NS + 1, FAILSAFE_NS, 10**12])
def test_a_gap_beyond_the_hold_limit_is_a_stall_of_that_length_while_armed(gap_ns: int) -> None:
    assert stall_of(SETTINGS, PERIOD_S, gap_ns, armed=True) == gap_ns
    assert stall_of(SETTINGS, PERIOD_S, gap_ns, armed=False) == 0


@pytest.mark.parametrize("gap_ns", [0, 1, HOLD_NS])
def test_a_shorter_gap_is_none(gap_ns: int) -> None:
    assert stall_of(SETTINGS, PERIOD_S, gap_ns, armed=True) == 0


def test_readings_count_up_to_the_hold_limit_and_an_arm_up_to_the_failsafe_limit() -> None:
    assert freshness(SETTINGS, PERIOD_S, NOW_NS, stalled=False) == Freshness(
        NOW_NS, NOW_NS - HOLD_NS, NOW_NS - FAILSAFE_NS
    )


def test_after_a_stall_nothing_counts_that_has_arrived() -> None:
    assert freshness(SETTINGS, PERIOD_S, NOW_NS, stalled=True) == Freshness(NOW_NS, NOW_NS + 1, NOW_NS + 1)


def test_a_frame_without_a_stamp_arrives_when_it_is_handled() -> None:
    fresh = Freshness(now_ns=NOW_NS)
    assert fresh.arrived_ns(CanFrame(1, b"", received_ns=7)) == 7
    assert fresh.arrived_ns(CanFrame(1, b"")) == NOW_NS


def test_a_command_may_be_sent_until_its_reading_is_as_old_as_hold_allows() -> None:
    state = GuardState(last=LastReceived(feedback_ns=NOW_NS))
    for now_ns in (NOW_NS, NOW_NS + 1, NOW_NS + HOLD_NS):
        assert deadline_ns(SETTINGS, state, PERIOD_S, now_ns) == NOW_NS + HOLD_NS


def test_without_a_fresh_reading_a_command_has_no_deadline() -> None:
    state = GuardState(last=LastReceived(feedback_ns=NOW_NS))
    assert deadline_ns(SETTINGS, state, PERIOD_S, NOW_NS + HOLD_NS + 1) is None
    assert deadline_ns(SETTINGS, GuardState(), PERIOD_S, NOW_NS) is None


GOOD = GuardState()
IDLE = GuardState(conditions=Conditions(no_effect=Cause.COMMAND_IGNORED))
FOREIGN = GuardState(last=LastReceived(foreign_ns=1))
BOTH = replace(IDLE, last=FOREIGN.last)


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        (GOOD, GOOD, False),
        (GOOD, IDLE, False),
        (GOOD, FOREIGN, False),
        (IDLE, GOOD, True),
        (IDLE, IDLE, False),
        (IDLE, FOREIGN, True),
        (FOREIGN, GOOD, True),
        (FOREIGN, FOREIGN, False),
        (FOREIGN, IDLE, True),
        (BOTH, GOOD, True),
        (BOTH, IDLE, True),
        (BOTH, FOREIGN, True),
        (BOTH, BOTH, False),
    ],
)
def test_commands_act_again_when_one_of_two_obstacles_is_gone(
    before: GuardState, after: GuardState, expected: bool
) -> None:
    assert after.acts_again(before) is expected


def test_failures_of_the_law_are_counted_in_a_row() -> None:
    failing = GuardState(law=LawRecord(failures=2, late_cycles=4, late_answers=5))
    assert failing.after_law(answered=False).law == LawRecord(failures=3, late_cycles=4, late_answers=5)
    assert failing.after_law(answered=True).law == LawRecord(failures=0, late_cycles=4, late_answers=5)
    assert GOOD.after_law(answered=True) is GOOD  # nothing is copied in a cycle without a failure


ACTIVE = GuardState(
    mode=Mode.ACTIVE,
    arming=Arming(armed=True, ever_armed=True, request=HostRequest.ARM),
    last=LastReceived(feedback_ns=NOW_NS, setpoint_ns=NOW_NS),
)


def supervised(state: GuardState, guard_input: GuardInput, conditions: Conditions = NOTHING_WRONG) -> GuardState:
    return supervise(SETTINGS, state, guard_input, PERIOD_S, NOW_NS, conditions)


def test_a_reading_and_a_setpoint_were_received_as_long_ago_as_their_ages_say() -> None:
    last = supervised(ACTIVE, GuardInput(feedback_age_ns=3 * MS, setpoint_age_ns=7 * MS)).last
    assert (last.feedback_ns, last.setpoint_ns) == (NOW_NS - 3 * MS, NOW_NS - 7 * MS)
    last = supervised(ACTIVE, GuardInput()).last
    assert (last.feedback_ns, last.setpoint_ns) == (NOW_NS, NOW_NS)


def test_answers_after_a_stall_are_counted_in_a_row() -> None:
    late, in_time = Conditions(answered=True, stall_ns=1), Conditions(answered=True)
    record = replace(ACTIVE, law=LawRecord(failures=1, late_cycles=2, late_answers=3))
    assert supervised(record, GuardInput(), late).law == LawRecord(failures=1, late_cycles=0, late_answers=4)
    assert supervised(record, GuardInput(), in_time).law == LawRecord(failures=1, late_cycles=0, late_answers=0)
    assert supervised(record, GuardInput(), Conditions(late=True)).law == LawRecord(1, 3, 3)


@pytest.mark.parametrize(
    ("conditions", "mode", "cause"),
    [
        (NOTHING_WRONG, Mode.ACTIVE, Cause.NONE),
        (Conditions(stall_ns=1), Mode.HOLD, Cause.STALLED),
        (Conditions(stall_ns=FAILSAFE_NS), Mode.HOLD, Cause.STALLED),
        (Conditions(stall_ns=FAILSAFE_NS + 1), Mode.FAILSAFE, Cause.STALLED),
        (Conditions(no_effect=Cause.COMMAND_IGNORED), Mode.ACTIVE, Cause.COMMAND_IGNORED),
        (Conditions(no_effect=Cause.ACTUATOR_FAILED, period_wrong=True), Mode.ACTIVE, Cause.ACTUATOR_FAILED),
    ],
)
def test_what_a_cycle_finds_wrong_decides_the_mode(conditions: Conditions, mode: Mode, cause: Cause) -> None:
    state = supervised(ACTIVE, GuardInput(feedback_age_ns=0, setpoint_age_ns=0), conditions)
    assert (state.mode, state.cause) == (mode, cause)
