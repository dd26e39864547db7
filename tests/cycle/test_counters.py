"""Counts by cause: the cause under which each event counts, and how the counts are sent one after another."""

from __future__ import annotations

from positioner.cycle.counters import Counters
from positioner.cycle.events import (
    FeedbackRefused,
    ForeignCommand,
    FrameRefused,
    FramesLost,
    LawFellBack,
    Learned,
    LinesDropped,
    ModeChanged,
    SetpointRefused,
    kind_of,
)
from positioner.cycle.timing_events import LawLate
from positioner.valve.stiction import Direction, LearnedSample, Quantity
from positioner.wire.messages import Cause, Counted, Mode, PositionerCount


def test_a_refused_frame_counts_by_its_cause_and_in_the_total_of_the_status() -> None:
    for counted in Counted:
        counters = Counters(refused_frames=5).add([FrameRefused("", counted=counted)] * 2)
        assert (counters.by_cause, counters.refused_frames) == ({counted: 2}, 7)


def test_every_event_counts_under_its_cause() -> None:
    events = (
        FramesLost("StemPosition", count=4),
        FramesLost("Setpoint", count=3),
        FeedbackRefused(0.3, "", counted=Counted.FEEDBACK_RANGE),
        FeedbackRefused(0.3, "", counted=Counted.FEEDBACK_FROZEN),
        SetpointRefused(0.3, 0.0, 0.1),
        ForeignCommand(12.0),
        LawLate(2_000_000, 0.001),
        LinesDropped(count=3),
    )
    assert Counters().add(events).by_cause == {
        Counted.LOST: 7,
        Counted.FEEDBACK_RANGE: 1,
        Counted.FEEDBACK_FROZEN: 1,
        Counted.SETPOINT_REFUSED: 1,
        Counted.FOREIGN_COMMAND: 1,
        Counted.LAW_LATE: 1,
        Counted.LINE_DROPPED: 3,
    }


def test_an_event_that_is_not_counted_changes_no_counter() -> None:
    counters = Counters().add([ForeignCommand(12.0)])
    assert counters.add([]) is counters
    assert counters.add([ModeChanged(Mode.INIT, Mode.READY, Cause.NONE)]) is counters


def test_fallbacks_and_lessons_count_in_the_totals_of_the_status_alone() -> None:
    lesson = Learned(LearnedSample(Quantity.BREAKAWAY_CURRENT, 0.08, Direction.OPENING, 1.0), 1)
    counters = Counters(fallbacks=1, learned=2).add([LawFellBack("no plan"), lesson, lesson])
    assert counters == Counters(fallbacks=2, learned=4)


def test_counts_go_on_from_what_they_were() -> None:
    before = Counters().add([ForeignCommand(12.0)])
    after = before.add([ForeignCommand(12.0), SetpointRefused(0.3, 0.0, 0.1)])
    assert after.by_cause == {Counted.FOREIGN_COMMAND: 2, Counted.SETPOINT_REFUSED: 1}
    assert before.by_cause == {Counted.FOREIGN_COMMAND: 1}


def test_nothing_is_sent_while_nothing_is_counted() -> None:
    counters = Counters()
    assert counters.next_message() == (counters, None)


def test_the_counts_are_sent_one_after_another_and_a_new_one_in_its_place() -> None:
    counters = Counters().add([ForeignCommand(12.0), FrameRefused("", counted=Counted.WRONG_CRC), LawLate(1, 0.001)])
    sent = []
    for cycle in range(7):
        if cycle == 4:
            counters = counters.add(
                [FrameRefused("", counted=Counted.REPEATED), FrameRefused("", counted=Counted.WRONG_CRC)]
            )
        counters, message = counters.next_message()
        sent.append(message)
    assert sent == [
        PositionerCount(Counted.WRONG_CRC, 1),
        PositionerCount(Counted.FOREIGN_COMMAND, 1),
        PositionerCount(Counted.LAW_LATE, 1),
        PositionerCount(Counted.WRONG_CRC, 1),
        PositionerCount(Counted.REPEATED, 1),
        PositionerCount(Counted.FOREIGN_COMMAND, 1),
        PositionerCount(Counted.LAW_LATE, 1),
    ]


def test_a_count_wraps_where_its_signal_does() -> None:
    for count, sent in ((2**32 - 1, 2**32 - 1), (2**32, 0), (2**32 + 5, 5)):
        assert Counters({Counted.LOST: count}).next_message()[1] == PositionerCount(Counted.LOST, sent)


def test_lines_of_the_log_have_one_kind_for_each_cause() -> None:
    assert kind_of(FrameRefused("", counted=Counted.WRONG_CRC)) == "FrameRefused: wrong CRC"
    assert kind_of(FeedbackRefused(0.3, "", counted=Counted.FEEDBACK_JUMP)) == "FeedbackRefused: reading jumped"
    assert kind_of(ForeignCommand(12.0)) == "ForeignCommand: command of another controller"
    assert kind_of(LawFellBack("")) == "LawFellBack"
