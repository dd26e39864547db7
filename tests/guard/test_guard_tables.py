"""The two tables of DESIGN.md's section on the guard, compared with the code."""

from __future__ import annotations

import random
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from hypothesis import example, given, settings
from hypothesis import strategies as st

from positioner.guard.manual import AUTOMATIC, Manual
from positioner.guard.settings import GuardSettings
from positioner.guard.state import Arming, Conditions, GuardInput, GuardState, LastReceived, LawRecord
from positioner.guard.supervisor import _mode, supervise
from positioner.wire.messages import Cause, HostRequest, ManualCurrent, ManualRequest, Mode

if TYPE_CHECKING:
    from collections.abc import Callable

MS = 1_000_000
PERIOD_S = 0.001
NOW_NS = 10**12
LIMITS = GuardSettings(setpoint_hold_s=0.005, setpoint_failsafe_s=0.02, law_failsafe_cycles=2)
AUTO, MANUAL = ManualCurrent(9.5, ManualRequest.AUTO), ManualCurrent(9.5)
NO_FEEDBACK = (Cause.FEEDBACK_STALE, Cause.FEEDBACK_IMPLAUSIBLE, Cause.FEEDBACK_DISPUTED, Cause.FEEDBACK_FROZEN)
NO_EFFECT = (Cause.ACTUATOR_FAILED, Cause.COMMAND_IGNORED)
DEVIATIONS = (Cause.NONE, Cause.DEVIATION, Cause.SETPOINT_UNREACHABLE)
NO_SETPOINT = (Cause.SETPOINT_STALE, Cause.SETPOINT_DISPUTED)


def rows_of(head: str) -> list[list[str]]:
    """Return the cells of the table of DESIGN.md whose first line is `head`."""
    lines = (Path(__file__).parents[2] / "DESIGN.md").read_text(encoding="utf-8").splitlines()
    start = lines.index(head) + 2
    end = next(number for number in range(start, len(lines)) if not lines[number].startswith("|"))
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[start:end]]


def cause_of(words: str) -> Cause:
    return Cause[words.partition(" (")[0].strip().replace(" ", "_").upper()]


def feedback_age_ms(state: GuardState) -> float:
    return (NOW_NS - (state.last.feedback_ns or 0)) / MS


def setpoint_age_s(state: GuardState) -> float:
    return (NOW_NS - (state.last.setpoint_ns or 0)) / 1e9


def is_by_hand(state: GuardState) -> bool:
    return state.manual.current_ma is not None


def manual_age_s(state: GuardState) -> float:
    return (NOW_NS - state.manual.received_ns) / 1e9 if state.manual.received_ns is not None else 0.0


MEANING: dict[str, Callable[[GuardState], bool]] = {
    "no valid feedback yet": lambda it: it.last.feedback_ns is None,
    "already failed safe, not armed again": lambda it: it.mode is Mode.FAILSAFE,
    "not armed, feedback older than `feedback_failsafe_periods`": lambda it: (
        not it.arming.armed and feedback_age_ms(it) > 10
    ),
    "not armed, another controller seen within 1 s": lambda it: not it.arming.armed and it.last.foreign_ns is not None,
    "not armed, was armed before": lambda it: not it.arming.armed and it.arming.ever_armed,
    "not armed": lambda it: not it.arming.armed,
    "the process stood still for longer than `feedback_failsafe_periods` (10)": lambda it: (
        it.conditions.stall_ns > 10 * MS
    ),
    "by hand, MANUAL_CURRENT older than `setpoint_failsafe_s` (10 s)": lambda it: manual_age_s(it) > 0.02,
    "by hand, MANUAL_CURRENT older than `setpoint_hold_s` (0.5 s)": lambda it: manual_age_s(it) > 0.005,
    "by hand, feedback older than `feedback_failsafe_periods`": lambda it: is_by_hand(it) and feedback_age_ms(it) > 10,
    "by hand, another controller seen within 1 s": lambda it: is_by_hand(it) and it.last.foreign_ns is not None,
    "by hand": is_by_hand,
    "feedback older than `feedback_failsafe_periods` (10)": lambda it: feedback_age_ms(it) > 10,
    "`law_failsafe_cycles` (10) cycles in a row without an answer of the law": lambda it: it.law.failures >= 2,
    "`law_failsafe_cycles` (10) answers of the law in a row that came too late to be used": lambda it: (
        it.law.late_answers >= 2
    ),
    "setpoint older than `setpoint_failsafe_s` (10 s)": lambda it: setpoint_age_s(it) > 0.02,
    "the process stood still for longer than `feedback_hold_periods` (3)": lambda it: it.conditions.stall_ns > 0,
    "feedback older than `feedback_hold_periods` (3)": lambda it: feedback_age_ms(it) > 3,
    "setpoint older than `setpoint_hold_s` (0.5 s)": lambda it: setpoint_age_s(it) > 0.005,
    "another controller seen within 1 s": lambda it: it.last.foreign_ns is not None,
    "the node's actuator obeys no command, or no newer command of ours is named as acting": lambda it: (
        it.conditions.no_effect is not None
    ),
    "a stem that swings without an end": lambda it: it.conditions.hunting,
    "an error that does not shrink (`deviation_of_span`, `deviation_s`)": lambda it: (
        it.conditions.deviation is not Cause.NONE
    ),
    "pushes that move neither the stem nor its reading": lambda it: it.conditions.no_motion,
    "position frames come at another period than `sample_period_s`, by a fifth": lambda it: it.conditions.period_wrong,
    "the law says that the valve does not move as configured": lambda it: it.conditions.valve_differs,
    "`law_failsafe_cycles` (10) cycles in a row longer than a period": lambda it: it.law.late_cycles >= 2,
    "otherwise": lambda _: True,
}
CONDITIONS = rows_of("| condition | mode | cause |")
AGES = st.one_of(st.none(), st.sampled_from([0, 3, 4, 5, 6, 10, 11, 20, 21]))


@given(
    mode=st.sampled_from(Mode),
    cause=st.sampled_from(Cause),
    armed=st.booleans(),
    ever_armed=st.booleans(),
    feedback_ms=AGES,
    setpoint_ms=AGES,
    foreign=st.booleans(),
    failures=st.integers(0, 3),
    no_feedback=st.sampled_from(NO_FEEDBACK),
    late=st.integers(0, 3),
    manual_ms=AGES,
    no_setpoint=st.sampled_from(NO_SETPOINT),
    stall_ms=st.sampled_from([0, 0, 4, 10, 11]),
    late_answers=st.integers(0, 3),
    no_effect=st.sampled_from((None, *NO_EFFECT)),
    deviation=st.sampled_from(DEVIATIONS),
    period_wrong=st.booleans(),
    valve_differs=st.booleans(),
    hunting=st.booleans(),
    no_motion=st.booleans(),
)
@example(
    Mode.ACTIVE,
    Cause.NONE,
    True,
    True,
    0,
    0,
    False,
    0,
    Cause.FEEDBACK_STALE,
    0,
    None,
    Cause.SETPOINT_STALE,
    0,
    0,
    None,
    Cause.NONE,
    False,
    False,
    False,
    False,
)
@settings(max_examples=600)
def test_the_first_row_that_holds_gives_mode_and_cause(
    mode: Mode,
    cause: Cause,
    armed: bool,
    ever_armed: bool,
    feedback_ms: int | None,
    setpoint_ms: int | None,
    foreign: bool,
    failures: int,
    no_feedback: Cause,
    late: int,
    manual_ms: int | None,
    no_setpoint: Cause,
    stall_ms: int,
    late_answers: int,
    no_effect: Cause | None,
    deviation: Cause,
    period_wrong: bool,
    valve_differs: bool,
    hunting: bool,
    no_motion: bool,
) -> None:
    state = GuardState(
        mode=mode,
        cause=cause,
        arming=Arming(armed=armed, ever_armed=ever_armed),
        last=LastReceived(
            feedback_ns=None if feedback_ms is None else NOW_NS - feedback_ms * MS,
            setpoint_ns=None if setpoint_ms is None else NOW_NS - setpoint_ms * MS,
            foreign_ns=NOW_NS if foreign else None,
            no_feedback=no_feedback,
            no_setpoint=no_setpoint,
        ),
        law=LawRecord(failures=failures, late_cycles=late, late_answers=late_answers),
        manual=AUTOMATIC if manual_ms is None else Manual(9.5, NOW_NS - manual_ms * MS),
        conditions=Conditions(
            stall_ns=stall_ms * MS,
            no_effect=no_effect,
            deviation=deviation,
            period_wrong=period_wrong,
            valve_differs=valve_differs,
            hunting=hunting,
            no_motion=no_motion,
        ),
    )
    _, its_mode, its_cause = next(row for row in CONDITIONS if MEANING[row[0]](state))
    if its_cause == "feedback stale, implausible, disputed or frozen":
        expected = no_feedback
    elif its_cause == "actuator failed or command ignored":
        assert no_effect is not None
        expected = no_effect
    elif its_cause == "setpoint stale or disputed":
        expected = no_setpoint
    elif its_cause == "deviation or setpoint unreachable":
        expected = deviation
    else:
        expected = cause if its_cause == "the cause it had" else cause_of(its_cause)
    assert _mode(LIMITS, state, PERIOD_S, NOW_NS) == (Mode[its_mode], expected)


def test_every_row_has_a_meaning_here() -> None:
    assert [condition for condition, _, _ in CONDITIONS] == list(MEANING)


def wander(steps: int) -> dict[tuple[Mode, Mode], set[Cause]]:
    """Return every transition, with its causes, that happens within `steps` random inputs."""
    chance, state, now_ns = random.Random(1), GuardState(), 1  # noqa: S311 - a walk that can be repeated, no secret
    found: defaultdict[tuple[Mode, Mode], set[Cause]] = defaultdict(set)
    for _ in range(steps):
        before = GuardState() if chance.random() < 0.02 else state
        now_ns += chance.choice((1, 1, 1, 4, 6, 11, 21, 1001)) * MS
        good = chance.random() < 0.6
        requests = tuple(chance.choices((*HostRequest, HostRequest.ARM), k=chance.randrange(3)))
        stall_ns = chance.choice((0, 0, 0, 0, 4, 11)) * MS if before.arming.armed else 0
        given = GuardInput(
            feedback_age_ns=0 if good else None,
            setpoint_age_ns=0 if chance.random() < 0.5 else None,
            requests=() if stall_ns else requests,
            waiting_request=requests[-1] if stall_ns and requests else None,
            foreign_command=chance.random() < 0.1,
            feedback_refused=None if good else chance.choice((None, *NO_FEEDBACK[1:])),
            manual=chance.choice((None, None, None, AUTO, MANUAL)),
            stray_disarm=chance.random() < 0.02,
            setpoint_refused=chance.choice((None, None, None, None, Cause.SETPOINT_DISPUTED)),
        )
        conditions = Conditions(
            stall_ns=stall_ns,
            answered=before.controls and chance.random() < 0.7,
            late=chance.random() < 0.4,
            period_wrong=chance.random() < 0.3,
            valve_differs=chance.random() < 0.3,
            hunting=before.controls and chance.random() < 0.2,
            no_motion=before.controls and chance.random() < 0.2,
            deviation=chance.choice((*DEVIATIONS, Cause.NONE)) if before.controls else Cause.NONE,
            no_effect=chance.choice((None, None, None, *NO_EFFECT)),
        )
        if before.controls and chance.random() < 0.4:
            before = before.after_law(answered=False)
        if chance.random() < 0.2:
            earlier_ns = before.arming.armed_or_returned_ns - 1001 * MS
            before = replace(before, arming=replace(before.arming, armed_or_returned_ns=earlier_ns))
        state = supervise(LIMITS, before, given, PERIOD_S, now_ns, conditions)
        if state.mode is not before.mode:
            found[before.mode, state.mode].add(state.cause)
    return dict(found)


def test_the_transitions_of_the_table_are_those_that_happen_and_no_others() -> None:
    written = {
        (Mode[one], Mode[other]): {cause_of(cause) for cause in causes.split(",")}
        for several, other, causes in rows_of("| from | to | causes |")
        for one in several.split(", ")
    }
    assert wander(150_000) == written
