"""The guard: every transition and its cause, arming, ages, and the limit of the current, whatever the law answers."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState, Setup
from positioner.cycle.step import step
from positioner.errors import ConfigurationError
from positioner.guard.settings import FailsafeAction, GuardSettings
from positioner.guard.state import (
    NOTHING_WRONG,
    Arming,
    Conditions,
    GuardInput,
    GuardState,
    LastReceived,
    LawRecord,
)
from positioner.guard.supervisor import admit, is_feedback_stale, supervise
from positioner.inputs.toml_reader import build
from positioner.laws.bounds import Bounds
from positioner.laws.law import Decision, Estimate, Observation
from positioner.valve.parameters import ValveParameters
from positioner.valve.state import StemState
from positioner.wire.codec import make_codec
from positioner.wire.messages import (
    CanFrame,
    Cause,
    Counted,
    CurrentCommand,
    Health,
    HostRequest,
    ManualCurrent,
    ManualRequest,
    Mode,
    PositionerCount,
    PositionerStatus,
    Quality,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from positioner.valve.stiction import StictionTable

PERIOD_S = 0.001
MS = 1_000_000
SECOND = 1000 * MS
SETTINGS = GuardSettings()
EVERYTHING = GuardInput(feedback_age_ns=0, setpoint_age_ns=0)
RELEASED = GuardInput(feedback_age_ns=0, setpoint_age_ns=0, requests=(HostRequest.NONE,))
ARM = GuardInput(feedback_age_ns=0, setpoint_age_ns=0, requests=(HostRequest.ARM,))
DISARM = GuardInput(feedback_age_ns=0, setpoint_age_ns=0, requests=(HostRequest.DISARM,))
NOTHING = GuardInput()


def watch(
    state: GuardState,
    given: GuardInput,
    now_ns: int,
    tuning: GuardSettings = SETTINGS,
    conditions: Conditions = NOTHING_WRONG,
) -> GuardState:
    return supervise(tuning, state, given, PERIOD_S, now_ns, conditions)


def ready_at(now_ns: int, tuning: GuardSettings = SETTINGS) -> GuardState:
    return watch(GuardState(), RELEASED, now_ns, tuning)


def long_armed() -> GuardState:
    active = active_at(SECOND)
    return replace(active, arming=replace(active.arming, armed_or_returned_ns=0))


def active_at(now_ns: int, tuning: GuardSettings = SETTINGS) -> GuardState:
    return watch(ready_at(now_ns, tuning), ARM, now_ns, tuning)


def mode_and_cause(state: GuardState) -> tuple[Mode, Cause]:
    return state.mode, state.cause


# modes and causes


def test_it_boots_silent_and_waits_for_feedback() -> None:
    state = watch(GuardState(), GuardInput(setpoint_age_ns=0), SECOND)
    assert mode_and_cause(state) == (Mode.INIT, Cause.WAITING_FOR_FEEDBACK)
    assert not state.transmits
    assert not state.controls


def test_feedback_makes_it_ready_and_nothing_more() -> None:
    state = ready_at(SECOND)
    assert mode_and_cause(state) == (Mode.READY, Cause.WAITING_FOR_ARM)
    assert not state.transmits


def test_arming_makes_it_active() -> None:
    state = active_at(SECOND)
    assert mode_and_cause(state) == (Mode.ACTIVE, Cause.NONE)
    assert state.transmits
    assert state.controls


def test_feedback_that_ends_before_arming_leads_back_to_the_beginning() -> None:
    state = ready_at(SECOND)
    assert mode_and_cause(watch(state, NOTHING, SECOND + 10 * MS)) == (Mode.READY, Cause.WAITING_FOR_ARM)
    assert mode_and_cause(watch(state, NOTHING, SECOND + 10 * MS + 1)) == (Mode.INIT, Cause.WAITING_FOR_FEEDBACK)


@pytest.mark.parametrize(
    ("age_ns", "expected"),
    [
        (3 * MS, (Mode.ACTIVE, Cause.NONE)),
        (3 * MS + 1, (Mode.HOLD, Cause.FEEDBACK_STALE)),
        (10 * MS, (Mode.HOLD, Cause.FEEDBACK_STALE)),
        (10 * MS + 1, (Mode.FAILSAFE, Cause.FEEDBACK_STALE)),
    ],
)
def test_feedback_ages_in_sample_periods(age_ns: int, expected: tuple[Mode, Cause]) -> None:
    assert mode_and_cause(watch(active_at(SECOND), GuardInput(setpoint_age_ns=0), SECOND + age_ns)) == expected
    # the same number of longer periods
    state = supervise(SETTINGS, active_at(SECOND), GuardInput(setpoint_age_ns=0), 0.1, SECOND + 100 * age_ns)
    assert mode_and_cause(state) == expected


@pytest.mark.parametrize(
    ("age_ns", "expected"),
    [
        (500 * MS, (Mode.ACTIVE, Cause.NONE)),
        (500 * MS + 1, (Mode.HOLD, Cause.SETPOINT_STALE)),
        (10 * SECOND, (Mode.HOLD, Cause.SETPOINT_STALE)),
        (10 * SECOND + 1, (Mode.FAILSAFE, Cause.SETPOINT_STALE)),
    ],
)
def test_the_setpoint_ages_in_seconds(age_ns: int, expected: tuple[Mode, Cause]) -> None:
    assert mode_and_cause(watch(active_at(SECOND), GuardInput(feedback_age_ns=0), SECOND + age_ns)) == expected


def test_a_hold_ends_when_what_was_missing_comes_back() -> None:
    held = watch(active_at(SECOND), NOTHING, SECOND + 5 * MS)
    assert held.mode is Mode.HOLD
    assert held.controls  # towards the setpoint it has
    assert mode_and_cause(watch(held, EVERYTHING, SECOND + 6 * MS)) == (Mode.ACTIVE, Cause.NONE)


def test_zero_means_that_a_setpoint_never_ages() -> None:
    for tuning, expected in (
        (GuardSettings(setpoint_hold_s=0.0, setpoint_failsafe_s=0.0), Mode.ACTIVE),
        (GuardSettings(setpoint_failsafe_s=0.0), Mode.HOLD),
        (GuardSettings(setpoint_hold_s=0.0), Mode.FAILSAFE),
        (GuardSettings(setpoint_hold_s=0.0, setpoint_failsafe_s=0.2), Mode.FAILSAFE),
    ):
        assert watch(active_at(SECOND, tuning), GuardInput(feedback_age_ns=0), 10**13, tuning).mode is expected


def test_a_law_that_keeps_failing_fails_safe() -> None:
    almost = replace(active_at(SECOND), law=LawRecord(failures=9))
    assert watch(almost, EVERYTHING, SECOND + MS).mode is Mode.ACTIVE
    enough = replace(almost, law=LawRecord(failures=10))
    assert mode_and_cause(watch(enough, EVERYTHING, SECOND + MS)) == (Mode.FAILSAFE, Cause.LAW_FAILED)


def test_failsafe_is_latched_with_its_cause() -> None:
    state = watch(active_at(SECOND), NOTHING, SECOND + 11 * MS)
    for later in range(12, 2000, 7):
        state = watch(state, EVERYTHING, SECOND + later * MS)
        assert mode_and_cause(state) == (Mode.FAILSAFE, Cause.FEEDBACK_STALE)
    assert state.transmits
    assert not state.controls


def test_the_worst_missing_input_gives_the_mode_not_the_one_missing_longest() -> None:
    late = SECOND + 11 * SECOND
    state = watch(active_at(SECOND), NOTHING, late)
    assert mode_and_cause(state) == (Mode.FAILSAFE, Cause.FEEDBACK_STALE)
    state = watch(active_at(SECOND), GuardInput(feedback_age_ns=0), SECOND + 600 * MS)
    assert mode_and_cause(watch(state, NOTHING, SECOND + 604 * MS)) == (Mode.HOLD, Cause.FEEDBACK_STALE)


@pytest.mark.parametrize("cause", [Cause.FEEDBACK_IMPLAUSIBLE, Cause.FEEDBACK_FROZEN])
def test_the_reason_why_readings_are_refused_is_the_cause(cause: Cause) -> None:
    doubted = GuardInput(setpoint_age_ns=0, feedback_refused=cause)
    state = watch(active_at(SECOND), doubted, SECOND + 3 * MS)
    assert mode_and_cause(state) == (Mode.ACTIVE, Cause.NONE)
    state = watch(state, doubted, SECOND + 4 * MS)
    assert mode_and_cause(state) == (Mode.HOLD, cause)
    assert mode_and_cause(watch(state, NOTHING, SECOND + 11 * MS)) == (Mode.FAILSAFE, cause)
    good = watch(state, GuardInput(feedback_age_ns=0, setpoint_age_ns=0, feedback_refused=cause), SECOND + 5 * MS)
    assert mode_and_cause(good) == (Mode.ACTIVE, Cause.NONE)
    assert mode_and_cause(watch(good, NOTHING, SECOND + 9 * MS)) == (Mode.HOLD, Cause.FEEDBACK_STALE)


def test_cycles_that_are_late_again_and_again_are_reported_and_one_in_time_ends_it() -> None:
    late = Conditions(late=True)
    state = active_at(SECOND)
    for cycle_number in range(1, 13):
        state = watch(state, EVERYTHING, SECOND + cycle_number * MS, conditions=late)
        expected = Cause.LAW_LATE if cycle_number >= 10 else Cause.NONE
        assert mode_and_cause(state) == (Mode.ACTIVE, expected)
        assert state.health(table_saved=True) is (Health.OUT_OF_SPECIFICATION if expected else Health.GOOD)
    assert mode_and_cause(watch(state, EVERYTHING, SECOND + 13 * MS)) == (Mode.ACTIVE, Cause.NONE)


# arming


def test_a_request_counts_when_it_changes() -> None:
    state = watch(active_at(SECOND), DISARM, SECOND + MS)
    assert mode_and_cause(state) == (Mode.READY, Cause.DISARMED)
    assert not state.arming.armed
    state = watch(state, DISARM, SECOND + 2 * MS)
    state = watch(state, ARM, SECOND + 3 * MS)
    assert mode_and_cause(state) == (Mode.ACTIVE, Cause.NONE)
    state = watch(state, ARM, SECOND + 4 * MS)
    assert mode_and_cause(state) == (Mode.ACTIVE, Cause.NONE)


def test_a_request_that_is_held_does_not_rearm_after_a_failsafe() -> None:
    state = watch(active_at(SECOND), NOTHING, SECOND + 11 * MS)
    state = watch(state, ARM, SECOND + 12 * MS)
    assert state.mode is Mode.FAILSAFE
    state = watch(state, RELEASED, SECOND + 13 * MS)
    assert state.mode is Mode.FAILSAFE
    state = watch(state, ARM, SECOND + 14 * MS)
    assert mode_and_cause(state) == (Mode.ACTIVE, Cause.NONE)


def test_arming_forgets_the_failures_of_the_law() -> None:
    failed = watch(replace(active_at(SECOND), law=LawRecord(failures=10)), EVERYTHING, SECOND + MS)
    assert mode_and_cause(failed) == (Mode.FAILSAFE, Cause.LAW_FAILED)
    released = watch(failed, GuardInput(feedback_age_ns=0, requests=(HostRequest.NONE,)), SECOND + 2 * MS)
    again = watch(released, ARM, SECOND + 3 * MS)
    assert mode_and_cause(again) == (Mode.ACTIVE, Cause.NONE)
    assert again.law.failures == 0


def test_an_arm_that_was_held_at_the_start_does_not_arm_until_something_else_was_asked() -> None:
    state = GuardState()
    for sample in range(50):
        state = watch(state, ARM, SECOND + sample * MS)
        assert mode_and_cause(state) == (Mode.READY, Cause.WAITING_FOR_ARM)
        assert not state.arming.ever_armed
    for released in (HostRequest.NONE, HostRequest.DISARM):
        other = watch(state, GuardInput(feedback_age_ns=0, setpoint_age_ns=0, requests=(released,)), SECOND + 50 * MS)
        assert not other.arming.armed
        assert mode_and_cause(watch(other, ARM, SECOND + 51 * MS)) == (Mode.ACTIVE, Cause.NONE)


@given(
    before=st.sampled_from([None, *HostRequest]),
    requests=st.lists(st.sampled_from(HostRequest), max_size=8),
    cuts=st.sets(st.integers(1, 7)),
)
def test_requests_mean_the_same_in_one_batch_and_in_many(
    before: HostRequest | None, requests: list[HostRequest], cuts: set[int]
) -> None:
    """Except a DISARM, which overrides all other requests of its batch."""
    requests = [request for request in requests if request is not HostRequest.DISARM]
    start = GuardState(
        mode=Mode.FAILSAFE,
        arming=Arming(armed=True, ever_armed=True, request=before),
        last=LastReceived(feedback_ns=SECOND),
    )
    bounds = [0, *sorted(cut for cut in cuts if cut < len(requests)), len(requests)]
    many = start
    for one, other in pairwise(bounds):
        many = watch(
            many, GuardInput(feedback_age_ns=0, setpoint_age_ns=0, requests=tuple(requests[one:other])), SECOND
        )
    one_batch = watch(start, GuardInput(feedback_age_ns=0, setpoint_age_ns=0, requests=tuple(requests)), SECOND)
    assert (one_batch.mode, one_batch.arming) == (many.mode, many.arming)
    seen = [*([] if before is None else [before]), *requests]
    edges = [other for one, other in pairwise(seen) if other is HostRequest.ARM and one is not HostRequest.ARM]
    assert (one_batch.mode is Mode.ACTIVE) is bool(edges)


@pytest.mark.parametrize("since_ms", [1, 500, 1000])
def test_a_foreign_command_right_after_the_arming_disarms(since_ms: int) -> None:
    alive = GuardInput(feedback_age_ns=0, setpoint_age_ns=0, requests=(HostRequest.ARM,))
    state = active_at(SECOND)
    for passed_ms in range(1, since_ms):
        state = watch(state, alive, SECOND + passed_ms * MS)
    state = watch(state, replace(alive, foreign_command=True), SECOND + since_ms * MS)
    assert mode_and_cause(state) == (Mode.READY, Cause.FOREIGN_COMMAND)
    assert not state.transmits
    for passed_ms in range(1, 3000):  # the held ARM does not arm again, however old the foreign command is
        state = watch(state, alive, SECOND + (since_ms + passed_ms) * MS)
        assert not state.arming.armed
    state = watch(watch(state, RELEASED, 5 * SECOND), ARM, 5 * SECOND + MS)
    assert mode_and_cause(state) == (Mode.ACTIVE, Cause.NONE)


def test_the_automatic_arming_waits_while_the_host_wants_it_disarmed() -> None:
    tuning = GuardSettings(auto_arm=True)
    state = watch(GuardState(), DISARM, SECOND, tuning)
    assert not watch(state, EVERYTHING, SECOND + MS, tuning).arming.armed
    assert watch(state, RELEASED, SECOND + MS, tuning).arming.armed


def test_a_batch_without_a_request_changes_no_request() -> None:
    state = watch(active_at(SECOND), EVERYTHING, SECOND + MS)
    assert state.arming.request is HostRequest.ARM


def test_arming_needs_fresh_feedback() -> None:
    state = ready_at(SECOND)
    asked = GuardInput(setpoint_age_ns=0, requests=(HostRequest.ARM,))
    assert watch(state, asked, SECOND + 3 * MS).arming.armed
    assert not watch(state, asked, SECOND + 3 * MS + 1).arming.armed
    assert not watch(GuardState(), asked, SECOND).arming.armed
    assert not watch(GuardState(), GuardInput(), SECOND, GuardSettings(auto_arm=True)).arming.armed


def test_an_arm_before_the_feedback_counts_when_it_is_repeated() -> None:
    early = watch(
        GuardState(arming=Arming(request=HostRequest.NONE)),
        GuardInput(setpoint_age_ns=0, requests=(HostRequest.ARM,)),
        0,
    )
    assert mode_and_cause(early) == (Mode.INIT, Cause.WAITING_FOR_FEEDBACK)
    ready = watch(early, GuardInput(feedback_age_ns=0), MS)
    assert mode_and_cause(ready) == (Mode.READY, Cause.WAITING_FOR_ARM)
    assert mode_and_cause(watch(ready, ARM, 2 * MS)) == (Mode.ACTIVE, Cause.NONE)


def test_a_foreign_command_forbids_arming_again_after_a_disarm() -> None:
    disarmed = watch(active_at(0), DISARM, MS)
    foreign = watch(disarmed, GuardInput(feedback_age_ns=0, setpoint_age_ns=0, foreign_command=True), 2 * MS)
    assert mode_and_cause(watch(foreign, ARM, 3 * MS)) == (Mode.READY, Cause.FOREIGN_COMMAND)


def test_arming_starts_the_age_of_the_setpoint_again() -> None:
    quiet = GuardInput(feedback_age_ns=0)
    state = watch(ready_at(SECOND), quiet, SECOND + 60 * SECOND)
    state = watch(state, GuardInput(feedback_age_ns=0, requests=(HostRequest.ARM,)), 61 * SECOND + MS)
    assert mode_and_cause(state) == (Mode.ACTIVE, Cause.NONE)
    assert mode_and_cause(watch(state, quiet, 61 * SECOND + 502 * MS)) == (Mode.HOLD, Cause.SETPOINT_STALE)


def test_asking_again_while_armed_does_not_refresh_the_setpoint() -> None:
    held = watch(active_at(SECOND), GuardInput(feedback_age_ns=0, requests=(HostRequest.NONE,)), SECOND + 600 * MS)
    assert held.mode is Mode.HOLD
    again = watch(held, GuardInput(feedback_age_ns=0, requests=(HostRequest.ARM,)), SECOND + 601 * MS)
    assert mode_and_cause(again) == (Mode.HOLD, Cause.SETPOINT_STALE)


def test_disarming_works_in_every_mode_and_silences() -> None:
    held = watch(active_at(SECOND), NOTHING, SECOND + 5 * MS)
    failed = watch(active_at(SECOND), NOTHING, SECOND + 11 * MS)
    for state in (ready_at(SECOND), active_at(SECOND), held, failed):
        off = watch(state, DISARM, SECOND + 12 * MS)
        assert off.arming.armed is False
        assert not off.transmits
        assert off.mode is Mode.READY


def test_a_stray_disarm_disarms_in_every_mode_and_is_no_request_that_an_arm_could_follow() -> None:
    """A replayed DISARM, while the host holds ARM, must not make this ARM arm a positioner that has failed safe."""
    stray = GuardInput(feedback_age_ns=0, setpoint_age_ns=0, stray_disarm=True)
    held = watch(active_at(SECOND), NOTHING, SECOND + 5 * MS)
    failed = watch(active_at(SECOND), NOTHING, SECOND + 11 * MS)
    for state in (active_at(SECOND), held, failed):
        off = watch(state, stray, SECOND + 12 * MS)
        assert mode_and_cause(off) == (Mode.READY, Cause.DISARMED)
        assert off.arming.request is state.arming.request
        again = watch(off, ARM, SECOND + 13 * MS)
        assert mode_and_cause(again) == (Mode.READY, Cause.DISARMED)
        again = watch(watch(again, RELEASED, SECOND + 14 * MS), ARM, SECOND + 15 * MS)
        assert mode_and_cause(again) == (Mode.ACTIVE, Cause.NONE)


def test_disputed_setpoints_age_and_are_the_cause_until_one_is_taken() -> None:
    disputed = GuardInput(feedback_age_ns=0, setpoint_refused=Cause.SETPOINT_DISPUTED)
    state = watch(active_at(SECOND), disputed, SECOND + 499 * MS)
    assert mode_and_cause(state) == (Mode.ACTIVE, Cause.NONE)
    state = watch(state, disputed, SECOND + 501 * MS)
    assert mode_and_cause(state) == (Mode.HOLD, Cause.SETPOINT_DISPUTED)
    assert mode_and_cause(watch(state, GuardInput(feedback_age_ns=0), SECOND + 502 * MS)) == (
        Mode.HOLD,
        Cause.SETPOINT_DISPUTED,
    )
    assert mode_and_cause(watch(state, disputed, 12 * SECOND)) == (Mode.FAILSAFE, Cause.SETPOINT_DISPUTED)
    taken = watch(state, EVERYTHING, SECOND + 502 * MS)
    assert mode_and_cause(taken) == (Mode.ACTIVE, Cause.NONE)
    assert mode_and_cause(watch(taken, GuardInput(feedback_age_ns=0), 2 * SECOND + 3 * MS)) == (
        Mode.HOLD,
        Cause.SETPOINT_STALE,
    )


def test_a_disarmed_positioner_reports_it() -> None:
    state = watch(active_at(SECOND), DISARM, SECOND + MS)
    assert mode_and_cause(watch(state, EVERYTHING, SECOND + 2 * MS)) == (Mode.READY, Cause.DISARMED)
    assert mode_and_cause(watch(state, NOTHING, SECOND + 20 * MS)) == (Mode.INIT, Cause.WAITING_FOR_FEEDBACK)


def test_auto_arm_arms_once_at_the_first_feedback() -> None:
    tuning = GuardSettings(auto_arm=True)
    assert not watch(GuardState(), GuardInput(setpoint_age_ns=0), SECOND, tuning).arming.armed
    state = watch(GuardState(), GuardInput(feedback_age_ns=0), SECOND, tuning)
    assert mode_and_cause(state) == (Mode.ACTIVE, Cause.NONE)
    failed = watch(state, NOTHING, SECOND + 11 * MS, tuning)
    assert watch(failed, EVERYTHING, SECOND + 12 * MS, tuning).mode is Mode.FAILSAFE
    off = watch(state, DISARM, SECOND + MS, tuning)
    assert watch(off, EVERYTHING, SECOND + 2 * MS, tuning).mode is Mode.READY


# foreign commands


FOREIGN = GuardInput(feedback_age_ns=0, setpoint_age_ns=0, foreign_command=True)


def test_a_foreign_command_forbids_the_first_arming_for_a_second() -> None:
    tuning = GuardSettings(auto_arm=True)
    state = watch(GuardState(), FOREIGN, SECOND, tuning)
    assert mode_and_cause(state) == (Mode.READY, Cause.FOREIGN_COMMAND)
    assert watch(state, EVERYTHING, 2 * SECOND, tuning).mode is Mode.READY
    assert watch(state, EVERYTHING, 2 * SECOND + 1, tuning).mode is Mode.ACTIVE


def test_a_foreign_command_while_armed_is_reported_and_does_not_stop_control() -> None:
    state = watch(long_armed(), FOREIGN, SECOND + MS)
    assert mode_and_cause(state) == (Mode.ACTIVE, Cause.FOREIGN_COMMAND)
    assert state.health(table_saved=True) is Health.FAILURE
    state = watch(state, EVERYTHING, 2 * SECOND + MS)
    assert state.cause is Cause.FOREIGN_COMMAND
    assert mode_and_cause(watch(state, EVERYTHING, 2 * SECOND + MS + 1)) == (Mode.ACTIVE, Cause.NONE)


# manual mode


def by_hand(current_ma: float = 9.5, *, feedback: bool = True, setpoint: bool = True) -> GuardInput:
    return GuardInput(
        feedback_age_ns=0 if feedback else None,
        setpoint_age_ns=0 if setpoint else None,
        manual=ManualCurrent(current_ma),
    )


AUTO = GuardInput(feedback_age_ns=0, setpoint_age_ns=0, manual=ManualCurrent(9.5, ManualRequest.AUTO))


def test_manual_mode_begins_and_ends_with_a_frame_and_only_while_armed() -> None:
    assert mode_and_cause(watch(ready_at(SECOND), by_hand(), SECOND)) == (Mode.READY, Cause.WAITING_FOR_ARM)
    state = watch(active_at(SECOND), by_hand(), SECOND)
    assert mode_and_cause(state) == (Mode.MANUAL, Cause.MANUAL)
    assert (state.manual_ma, state.transmits, state.controls) == (9.5, True, False)
    assert admit(SETTINGS, state, state.manual_ma, 9.0, PERIOD_S) == 9.5
    state = watch(state, by_hand(11.0), SECOND + MS)
    assert state.manual_ma == 11.0
    state = watch(state, EVERYTHING, SECOND + 2 * MS)
    assert (state.mode, state.manual_ma) == (Mode.MANUAL, 11.0)
    state = watch(state, AUTO, SECOND + 3 * MS)
    assert mode_and_cause(state) == (Mode.ACTIVE, Cause.NONE)
    assert state.manual_ma is None


def test_disarming_ends_manual_mode() -> None:
    state = watch(watch(active_at(SECOND), by_hand(), SECOND), DISARM, SECOND + MS)
    assert mode_and_cause(state) == (Mode.READY, Cause.DISARMED)
    assert (state.manual_ma, state.transmits) == (None, False)


@pytest.mark.parametrize(
    ("age_ns", "expected"),
    [
        (500 * MS, (Mode.MANUAL, Cause.MANUAL)),
        (500 * MS + 1, (Mode.MANUAL, Cause.SETPOINT_STALE)),
        (10 * SECOND, (Mode.MANUAL, Cause.SETPOINT_STALE)),
        (10 * SECOND + 1, (Mode.FAILSAFE, Cause.SETPOINT_STALE)),
    ],
)
def test_in_manual_mode_only_the_manual_frame_is_the_hosts_sign_of_life(
    age_ns: int, expected: tuple[Mode, Cause]
) -> None:
    state = watch(active_at(SECOND), by_hand(), SECOND)
    state = watch(state, EVERYTHING, SECOND + age_ns)
    assert mode_and_cause(state) == expected
    if state.mode is Mode.MANUAL:
        assert state.manual_ma == 9.5


def test_zero_means_that_a_manual_current_never_ages() -> None:
    tuning = replace(SETTINGS, setpoint_hold_s=0.0, setpoint_failsafe_s=0.0)
    state = watch(active_at(SECOND, tuning), by_hand(), SECOND, tuning)
    state = watch(state, EVERYTHING, 10**6 * SECOND, tuning)
    assert mode_and_cause(state) == (Mode.MANUAL, Cause.MANUAL)


def test_lost_feedback_is_reported_and_does_not_end_manual_mode() -> None:
    state = watch(active_at(SECOND), by_hand(), SECOND)
    state = watch(state, by_hand(feedback=False), SECOND + 10 * MS)
    assert mode_and_cause(state) == (Mode.MANUAL, Cause.MANUAL)
    state = watch(state, by_hand(8.0, feedback=False), SECOND + 10 * MS + 1)
    assert mode_and_cause(state) == (Mode.MANUAL, Cause.FEEDBACK_STALE)
    assert state.manual_ma == 8.0
    assert mode_and_cause(watch(state, GuardInput(manual=AUTO.manual), 2 * SECOND)) == (
        Mode.FAILSAFE,
        Cause.FEEDBACK_STALE,
    )
    assert mode_and_cause(watch(state, by_hand(), 2 * SECOND)) == (Mode.MANUAL, Cause.MANUAL)


def test_a_valve_whose_sensor_died_is_armed_again_while_the_host_asks_for_manual_mode() -> None:
    dead = watch(active_at(SECOND), NOTHING, 2 * SECOND)
    assert mode_and_cause(dead) == (Mode.FAILSAFE, Cause.FEEDBACK_STALE)
    arm = GuardInput(setpoint_age_ns=0, requests=(HostRequest.ARM,))
    none = GuardInput(setpoint_age_ns=0, requests=(HostRequest.NONE,))
    dead = watch(dead, none, 2 * SECOND + MS)
    assert watch(dead, arm, 2 * SECOND + 2 * MS).mode is Mode.FAILSAFE
    asked = watch(dead, by_hand(feedback=False), 2 * SECOND + 2 * MS)
    assert asked.mode is Mode.FAILSAFE
    state = watch(asked, arm, 2 * SECOND + 502 * MS)
    assert mode_and_cause(state) == (Mode.MANUAL, Cause.FEEDBACK_STALE)
    assert watch(asked, arm, 2 * SECOND + 502 * MS + 1).mode is Mode.FAILSAFE
    never = watch(GuardState(arming=Arming(request=HostRequest.NONE)), by_hand(feedback=False), SECOND)
    assert not watch(never, replace(arm, manual=ManualCurrent(9.5)), SECOND).arming.armed


def test_arming_long_after_the_last_manual_frame_begins_in_automatic_mode() -> None:
    state = watch(watch(active_at(SECOND), by_hand(), SECOND), EVERYTHING, 20 * SECOND)
    assert mode_and_cause(state) == (Mode.FAILSAFE, Cause.SETPOINT_STALE)
    state = watch(watch(state, RELEASED, 20 * SECOND), ARM, 20 * SECOND)
    assert mode_and_cause(state) == (Mode.ACTIVE, Cause.NONE)


def test_back_in_automatic_mode_the_host_has_its_time_to_send_a_setpoint() -> None:
    state = watch(active_at(SECOND), by_hand(), SECOND)
    for second in range(2, 20):
        state = watch(state, by_hand(setpoint=False), second * SECOND)
    auto = GuardInput(feedback_age_ns=0, manual=ManualCurrent(0.0, ManualRequest.AUTO))
    state = watch(state, auto, 19 * SECOND + 400 * MS)
    assert mode_and_cause(state) == (Mode.ACTIVE, Cause.NONE)
    state = watch(state, auto, 19 * SECOND + 500 * MS + 1)
    assert mode_and_cause(state) == (Mode.HOLD, Cause.SETPOINT_STALE)


def test_another_controller_in_manual_mode_is_a_failure_that_is_reported() -> None:
    state = watch(long_armed(), by_hand(), SECOND)
    state = watch(state, replace(by_hand(), foreign_command=True), SECOND + MS)
    assert mode_and_cause(state) == (Mode.MANUAL, Cause.FOREIGN_COMMAND)
    assert state.health(table_saved=True) is Health.FAILURE


# deviation


@pytest.mark.parametrize("cause", [Cause.DEVIATION, Cause.SETPOINT_UNREACHABLE])
def test_an_error_that_stays_is_out_of_specification_and_control_goes_on(cause: Cause) -> None:
    deviates = Conditions(deviation=cause)
    state = watch(active_at(SECOND), EVERYTHING, SECOND + MS, conditions=deviates)
    assert mode_and_cause(state) == (Mode.ACTIVE, cause)
    assert state.controls
    assert state.health(table_saved=True) is Health.OUT_OF_SPECIFICATION
    # the worse cause comes first
    assert watch(state, FOREIGN, SECOND + 2 * MS, conditions=deviates).cause is Cause.FOREIGN_COMMAND
    held = watch(state, NOTHING, SECOND + 5 * MS, conditions=deviates)
    assert mode_and_cause(held) == (Mode.HOLD, Cause.FEEDBACK_STALE)
    assert mode_and_cause(watch(state, EVERYTHING, SECOND + 2 * MS)) == (Mode.ACTIVE, Cause.NONE)


# health


@pytest.mark.parametrize(
    ("mode", "saved", "expected"),
    [
        (Mode.INIT, True, Health.FUNCTION_CHECK),
        (Mode.READY, True, Health.FUNCTION_CHECK),
        (Mode.ACTIVE, True, Health.GOOD),
        (Mode.ACTIVE, False, Health.MAINTENANCE_REQUIRED),
        (Mode.HOLD, False, Health.OUT_OF_SPECIFICATION),
        (Mode.FAILSAFE, True, Health.FAILURE),
        (Mode.MANUAL, False, Health.FUNCTION_CHECK),
    ],
)
def test_health_is_the_ne_107_signal_of_the_mode(mode: Mode, saved: bool, expected: Health) -> None:
    assert GuardState(mode).health(table_saved=saved) is expected


# staleness


def test_feedback_is_stale_after_what_hold_tolerates() -> None:
    state = ready_at(SECOND)
    assert not is_feedback_stale(SETTINGS, state, PERIOD_S, SECOND + 3 * MS)
    assert is_feedback_stale(SETTINGS, state, PERIOD_S, SECOND + 3 * MS + 1)
    assert not is_feedback_stale(SETTINGS, GuardState(), PERIOD_S, 10**15)


# the limit of the current


@pytest.mark.parametrize("mode", [Mode.INIT, Mode.READY])
def test_nothing_is_sent_before_arming(mode: Mode) -> None:
    assert admit(SETTINGS, GuardState(mode), 12.0, 12.0, PERIOD_S) is None


@pytest.mark.parametrize("mode", [Mode.ACTIVE, Mode.HOLD])
def test_a_current_inside_the_limits_passes(mode: Mode) -> None:
    assert admit(SETTINGS, GuardState(mode), 12.345, 4.0, PERIOD_S) == 12.345


@pytest.mark.parametrize(("wanted_ma", "expected_ma"), [(20.1, 20.0), (3.9, 4.0), (-1e300, 4.0), (1e300, 20.0)])
def test_a_current_beyond_the_limits_is_cut_off(wanted_ma: float, expected_ma: float) -> None:
    assert admit(SETTINGS, GuardState(Mode.ACTIVE), wanted_ma, 12.0, PERIOD_S) == expected_ma


@pytest.mark.parametrize("wanted_ma", [None, math.nan, math.inf, -math.inf])
def test_without_a_number_the_last_current_stays(wanted_ma: float | None) -> None:
    assert admit(SETTINGS, GuardState(Mode.ACTIVE), wanted_ma, 12.0, PERIOD_S) == 12.0
    assert admit(SETTINGS, GuardState(Mode.ACTIVE), wanted_ma, 1.57, PERIOD_S) == 4.0


@pytest.mark.parametrize(
    ("wanted_ma", "elapsed_s", "expected_ma"),
    [
        (20.0, 0.001, 12.5),
        (4.0, 0.001, 11.5),
        (12.4, 0.001, 12.4),
        (20.0, 0.01, 17.0),
        (20.0, 1.0, 20.0),
        (20.0, 0.0, 12.0),
    ],
)
def test_a_rate_limit_holds_both_ways(wanted_ma: float, elapsed_s: float, expected_ma: float) -> None:
    tuning = GuardSettings(max_rate_ma_per_s=500.0)
    assert admit(tuning, GuardState(Mode.ACTIVE), wanted_ma, 12.0, elapsed_s) == pytest.approx(expected_ma)
    # a slower one, in as much more time
    slower = GuardSettings(max_rate_ma_per_s=0.5)
    assert admit(slower, GuardState(Mode.ACTIVE), wanted_ma, 12.0, 1000.0 * elapsed_s) == pytest.approx(expected_ma)


@pytest.mark.parametrize(
    ("action", "expected_ma"),
    [
        (FailsafeAction.LOW, 4.0),
        (FailsafeAction.HIGH, 20.0),
        (FailsafeAction.CURRENT, 7.5),
        (FailsafeAction.KEEP_CURRENT, 12.0),
    ],
)
def test_failsafe_commands_what_was_chosen_whatever_the_law_wants(action: FailsafeAction, expected_ma: float) -> None:
    tuning = GuardSettings(failsafe_action=action, failsafe_current_ma=7.5, max_rate_ma_per_s=1.0)
    assert admit(tuning, GuardState(Mode.FAILSAFE), 18.0, 12.0, PERIOD_S) == expected_ma


def test_a_failsafe_that_holds_stays_inside_the_limits() -> None:
    tuning = GuardSettings(failsafe_action=FailsafeAction.KEEP_CURRENT)
    assert admit(tuning, GuardState(Mode.FAILSAFE), None, 1.57, PERIOD_S) == 4.0
    assert admit(tuning, GuardState(Mode.FAILSAFE), None, 25.0, PERIOD_S) == 20.0


@given(
    st.sampled_from(list(Mode)),
    st.one_of(st.none(), st.floats()),
    st.floats(0.0, 25.0),
    st.floats(0.0, 1.0),
    st.sampled_from([0.0, 10.0]),
    st.sampled_from(list(FailsafeAction)),
)
def test_every_command_is_within_the_limits_whatever_happens(
    mode: Mode, wanted_ma: float | None, last_ma: float, elapsed_s: float, rate: float, action: FailsafeAction
) -> None:
    tuning = GuardSettings(
        current_low_ma=3.9,
        current_high_ma=20.4,
        max_rate_ma_per_s=rate,
        failsafe_action=action,
        failsafe_current_ma=9.0,
    )
    sent_ma = admit(tuning, GuardState(mode), wanted_ma, last_ma, elapsed_s)
    if sent_ma is None:
        assert mode in {Mode.INIT, Mode.READY}
    else:
        assert mode not in {Mode.INIT, Mode.READY}
        assert 3.9 <= sent_ma <= 20.4


# settings


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"current_low_ma": 12.0, "current_high_ma": 12.0}, "current_low_ma must be below"),
        ({"feedback_hold_periods": 10}, "feedback_failsafe_periods must exceed"),
        ({"setpoint_hold_s": 10.0}, "setpoint_failsafe_s must exceed"),
        ({"setpoint_hold_s": 0.5, "setpoint_failsafe_s": 0.4}, "setpoint_failsafe_s must exceed"),
        ({"current_high_ma": 21.0}, "20.5"),
        ({"failsafe_action": "middle"}, "'4 mA', '20 mA', 'hold' or 'current'"),
    ],
)
def test_limits_that_make_no_sense_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        build(values, GuardSettings, "guard")


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"current_low_ma": 12.0, "current_high_ma": 11.0}, "current_low_ma must be below current_high_ma"),
        ({"feedback_hold_periods": 10}, "feedback_failsafe_periods must exceed feedback_hold_periods"),
        ({"setpoint_hold_s": 10.0}, "setpoint_failsafe_s must exceed setpoint_hold_s, or be 0 for never"),
        (
            {"failsafe_current_ma": 3.7},
            "failsafe_current_ma must be a value (3.8 to 20.5) or a failure signal (≤ 3.6 or ≥ 21)",
        ),
    ],
)
def test_what_makes_no_sense_is_reported_in_one_line(values: dict[str, Any], line: str) -> None:
    with pytest.raises(ValueError, match="must") as caught:
        GuardSettings(**values)
    assert str(caught.value) == line


# everything at once, at the level of a whole cycle

CODEC = make_codec()
VALVE = ValveParameters(id="any")
LIMITS = GuardSettings(
    current_low_ma=3.9,
    current_high_ma=20.2,
    law_failsafe_cycles=3,
    setpoint_hold_s=0.05,
    setpoint_failsafe_s=0.2,
    failsafe_action=FailsafeAction.KEEP_CURRENT,
    frozen_s=0.03,
)
WIDE = Bounds(-10.0, 10.0, 4.0, 20.0)


class WhimsicalLaw:
    """A law that raises, or answers anything, as `answer` asks."""

    name = "whimsical"

    def __init__(self, answer: object = 12.0) -> None:
        self.answer: Any = answer

    def begin(self, measured_m: float) -> float:
        return measured_m

    def estimate(self, memory: float, observation: Observation) -> tuple[float, Estimate]:
        if self.answer == "raise early":
            raise ZeroDivisionError
        return memory, Estimate(StemState(observation.measured_m, 0.0, stuck=True, direction=1.0))

    def decide(
        self, memory: float, stem: StemState, observation: Observation, table: StictionTable
    ) -> tuple[float, Any]:
        del stem, observation, table
        if self.answer == "raise late":
            raise RuntimeError("no idea")
        if self.answer == "nothing":
            return memory, None
        if self.answer == "half an answer":
            return memory, SimpleNamespace(current_ma=None)
        return memory, Decision(self.answer, WIDE)


class AnythingOnTheBus(RuleBasedStateMachine):
    """Frames, faults, silences and laws in any order; the invariants are the guard's promises."""

    def __init__(self) -> None:
        super().__init__()
        self.law = WhimsicalLaw()
        self.setup = Setup(CODEC, VALVE, LIMITS, self.law, PERIOD_S)
        self.state = CycleState()
        self.now_ns = SECOND
        self.counters = {StemPosition: 0, Setpoint: 0, CurrentCommand: 0, ManualCurrent: 0}
        self.was_armed = False
        self.feedback_ns: int | None = None
        self.usable_ns: int | None = None
        self.failures = 0

    def cycle(self, *frames: CanFrame, good: bool = False, late_ns: int = 0) -> None:
        """Let a cycle pass and check the frames that it sends."""
        self.state, outbox, _ = step(self.setup, self.state, CycleInput(frames, self.now_ns, late_ns))
        guard = self.state.guard
        self.was_armed |= guard.arming.armed
        if good:
            self.feedback_ns = self.now_ns
        sent = [CODEC.decode(frame)[0] for frame in outbox]
        assert all(isinstance(message, CurrentCommand | PositionerStatus | PositionerCount) for message in sent)
        commands = [message for message in sent if isinstance(message, CurrentCommand)]
        assert len(commands) <= 1
        if not self.was_armed:
            assert not commands
        if guard.last.feedback_ns is None:
            assert not sent
        for command in commands:
            assert guard.arming.armed
            assert LIMITS.current_low_ma - 5e-4 <= command.current_ma <= LIMITS.current_high_ma + 5e-4
            assert command.mode is guard.mode

    def next_counter(self, kind: type[StemPosition | Setpoint | CurrentCommand | ManualCurrent], step: int = 1) -> int:
        self.counters[kind] += step
        return self.counters[kind]

    @rule(
        position_m=st.floats(0.0, 0.1397),
        lost=st.integers(0, 3),
        quality=st.sampled_from([Quality.VALID, Quality.VALID, Quality.SUSPECT, Quality.FAULT]),
        echo=st.integers(0, 255),
        request=st.sampled_from([None, None, None, *HostRequest]),
        setpoint_m=st.floats(-0.05, 0.2),
        elapsed_ns=st.integers(0, 2 * MS),
    )
    def sample(
        self,
        position_m: float,
        lost: int,
        quality: Quality,
        echo: int,
        request: HostRequest | None,
        setpoint_m: float,
        elapsed_ns: int,
    ) -> None:
        self.now_ns += elapsed_ns
        frames = [CODEC.encode(StemPosition(position_m, echo, quality), self.next_counter(StemPosition, lost + 1))]
        if request is not None:
            frames.append(CODEC.encode(Setpoint(setpoint_m, request), self.next_counter(Setpoint)))
        self.cycle(*frames, good=quality is not Quality.FAULT)

    @rule(
        data=st.binary(max_size=8),
        identifier=st.sampled_from([0x100, 0x110, 0x120, 0x121, 0x111, 0x7FF]),
        kind=st.integers(0, 3),
    )
    def garbage(self, data: bytes, identifier: int, kind: int) -> None:
        self.cycle(CanFrame(identifier, data, is_error=kind == 1, is_remote=kind == 2, is_extended=kind == 3))

    @rule(current_ma=st.floats(0.0, 25.0))
    def foreign_command(self, current_ma: float) -> None:
        self.cycle(CODEC.encode(CurrentCommand(current_ma), self.next_counter(CurrentCommand)))

    @rule(current_ma=st.floats(0.0, 25.0), request=st.sampled_from(ManualRequest))
    def by_hand(self, current_ma: float, request: ManualRequest) -> None:
        learned, samples = self.state.counters.learned, self.state.table.sequence
        self.cycle(CODEC.encode(ManualCurrent(current_ma, request), self.next_counter(ManualCurrent)))
        assert (self.state.counters.learned, self.state.table.sequence) == (learned, samples)

    @rule(repeat=st.integers(1, 30), elapsed_ns=st.integers(MS // 10, 5 * MS))
    def silence(self, repeat: int, elapsed_ns: int) -> None:
        for _ in range(repeat):
            self.now_ns += elapsed_ns
            self.cycle()

    @rule(
        answer=st.one_of(
            st.sampled_from(["raise early", "raise late", "nothing", "half an answer", math.nan, math.inf, -math.inf]),
            st.floats(-1e9, 1e9),
            st.just(12.0),
        )
    )
    def change_of_mind(self, answer: object) -> None:
        self.law.answer = answer

    @rule(repeat=st.integers(1, 12), setpoint_m=st.floats(0.0, 0.1397))
    def regular_life(self, repeat: int, setpoint_m: float) -> None:
        """Valid feedback and setpoints, and a new ARM: also the way back from FAILSAFE."""
        here_m = self.state.link.feedback.readings.position_m or 0.08
        for request in (HostRequest.NONE, *[HostRequest.ARM] * repeat):
            self.now_ns += MS
            self.cycle(
                CODEC.encode(StemPosition(here_m), self.next_counter(StemPosition)),
                CODEC.encode(Setpoint(setpoint_m, request), self.next_counter(Setpoint)),
                good=True,
            )

    @rule(repeat=st.integers(1, 60))
    def frozen_sensor(self, repeat: int) -> None:
        """The same reading again and again while the law asks for 20 mA; a frozen sensor never keeps it ACTIVE."""
        self.law.answer = 20.0
        pushed_ns = None
        for _ in range(repeat):
            self.now_ns += MS
            frame = CODEC.encode(StemPosition(0.08), self.next_counter(StemPosition))
            self.cycle(frame, CODEC.encode(Setpoint(0.1), self.next_counter(Setpoint)), good=True)
            pushes = self.state.guard.mode is Mode.ACTIVE and self.state.link.feedback.readings.position_m == 0.08
            pushed_ns = (pushed_ns or self.now_ns) if pushes and (self.state.output.last_ma or 0.0) > 19.5 else None
            assert pushed_ns is None or self.now_ns - pushed_ns <= (30 + 1 + 4) * MS

    @rule(number=st.integers(0, 300))
    def peer_restarts_or_loses_frames(self, number: int) -> None:
        for kind in self.counters:
            self.counters[kind] += number

    @rule(step=st.integers(0, 40), flipped=st.integers(0, 63), current_ma=st.floats(0.0, 25.0))
    def replayed_and_damaged(self, step: int, flipped: int, current_ma: float) -> None:
        """A command with a broken bit is refused; a position of an old counter may be that of a restarted sensor."""
        old = CODEC.encode(StemPosition(0.01), self.counters[StemPosition] - step)
        word = int.from_bytes(CODEC.encode(CurrentCommand(current_ma), 0).data, "big") ^ 1 << flipped
        before = self.state.counters.refused_frames
        self.cycle(CanFrame(0x100, word.to_bytes(8, "big")))
        assert self.state.counters.refused_frames == before + 1
        self.cycle(old, good=True)

    @rule(spent_ns=st.integers(1, SECOND))
    def late_cycle(self, spent_ns: int) -> None:
        self.cycle(late_ns=spent_ns)

    @invariant()
    def what_is_refused_is_counted_by_its_cause(self) -> None:
        refused = {Counted.WRONG_LENGTH, Counted.WRONG_CRC, Counted.OUT_OF_RANGE, Counted.UNDEFINED_VALUE}
        refused |= {Counted.REPEATED, Counted.OUT_OF_ORDER, Counted.ERROR_FRAME, Counted.REMOTE_FRAME}
        counts = self.state.counters.by_cause
        assert sum(counts.get(kind, 0) for kind in refused) == self.state.counters.refused_frames

    @invariant()
    def it_fails_safe_in_time(self) -> None:
        """Assert the largest ages that the settings allow; `feedback_ns` is never older than the true instant."""
        guard = self.state.guard
        if not guard.arming.armed:
            assert not guard.transmits
            return
        assert guard.last.feedback_ns is not None
        age_ns = self.now_ns - guard.last.feedback_ns
        assert self.feedback_ns is not None
        assert guard.last.feedback_ns <= self.feedback_ns
        if guard.mode is Mode.MANUAL:
            assert guard.manual.received_ns is not None
            assert self.now_ns - guard.manual.received_ns <= 0.2 * SECOND
            return
        if age_ns > 10 * MS:
            assert guard.mode is Mode.FAILSAFE
        elif age_ns > 3 * MS:
            assert guard.mode in {Mode.HOLD, Mode.FAILSAFE}
        assert guard.last.setpoint_ns is not None
        if self.now_ns - guard.last.setpoint_ns > 0.2 * SECOND:
            assert guard.mode is Mode.FAILSAFE
        # one cycle more than allowed: the guard decides at the beginning of the next one
        assert guard.law.failures <= LIMITS.law_failsafe_cycles

    @invariant()
    def a_control_law_counts_only_where_it_may(self) -> None:
        if not self.state.guard.controls:
            assert self.state.control.memory is None


TestAnythingOnTheBus = AnythingOnTheBus.TestCase
TestAnythingOnTheBus.settings = settings(
    max_examples=60, stateful_step_count=40, suppress_health_check=[HealthCheck.too_slow]
)


@pytest.mark.parametrize(
    "answer", ["raise early", "raise late", "nothing", "half an answer", math.nan, math.inf, -math.inf]
)
def test_a_law_without_a_usable_answer_keeps_the_last_current_and_then_fails_safe(answer: object) -> None:
    law = WhimsicalLaw()
    tuning = GuardSettings(auto_arm=True, law_failsafe_cycles=3)
    setup = Setup(CODEC, VALVE, tuning, law, PERIOD_S)
    state, commands = CycleState(), []
    for sample in range(8):
        law.answer = 13.0 if sample < 2 else answer
        frame = CODEC.encode(StemPosition(0.08), sample)
        state, outbox, _ = step(setup, state, CycleInput((frame,), (1000 + sample) * MS))
        (command,) = [m for m, _ in map(CODEC.decode, outbox) if isinstance(m, CurrentCommand)]
        commands.append((command.current_ma, command.mode))
    assert commands == [(13.0, Mode.ACTIVE)] * 5 + [(4.0, Mode.FAILSAFE)] * 3
    assert mode_and_cause(state.guard) == (Mode.FAILSAFE, Cause.LAW_FAILED)
    assert state.counters.fallbacks == 3
