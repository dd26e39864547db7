"""Counts by cause: what counts as what, and how they are told in turn."""

from __future__ import annotations

from positioner.cycle.counters import COUNTED_REASONS, Counters
from positioner.cycle.events import (
    FeedbackRefused,
    ForeignCommand,
    FrameRefused,
    FramesLost,
    LawFellBack,
    LinesDropped,
    ModeChanged,
    SetpointRefused,
    kind_of,
)
from positioner.cycle.timing_events import LawLate
from positioner.wire.formats import Reason
from positioner.wire.messages import Cause, Counted, Mode, PositionerCount


def test_every_reason_to_refuse_a_frame_is_counted_by_its_name_but_other_nodes_traffic() -> None:
    assert set(COUNTED_REASONS) == set(Reason) - {Reason.UNKNOWN_ID}
    assert {reason.name: counted.name for reason, counted in COUNTED_REASONS.items()} == {
        reason.name: reason.name for reason in COUNTED_REASONS
    }
    for reason, counted in COUNTED_REASONS.items():
        assert Counters().add([FrameRefused(reason, "")] * 2).counts == {counted: 2}


def test_every_trouble_counts_as_what_it_is() -> None:
    events = (
        FramesLost("StemPosition", 4),
        FramesLost("Setpoint", 3),
        FeedbackRefused(0.3, "", Counted.FEEDBACK_RANGE),
        FeedbackRefused(0.3, "", Counted.FEEDBACK_FROZEN),
        SetpointRefused(0.3, 0.0, 0.1),
        ForeignCommand(12.0),
        LawLate(2_000_000, 0.001),
        LinesDropped(3),
    )
    assert Counters().add(events).counts == {
        Counted.LOST: 7,
        Counted.FEEDBACK_RANGE: 1,
        Counted.FEEDBACK_FROZEN: 1,
        Counted.SETPOINT_REFUSED: 1,
        Counted.FOREIGN_COMMAND: 1,
        Counted.LAW_LATE: 1,
        Counted.LINE_DROPPED: 3,
    }


def test_what_is_no_trouble_leaves_the_very_same_tally() -> None:
    counters = Counters().add([ForeignCommand(12.0)])
    assert counters.add([]) is counters
    assert counters.add([ModeChanged(Mode.INIT, Mode.READY, Cause.NONE), LawFellBack("no plan")]) is counters


def test_counts_go_on_from_what_they_were() -> None:
    before = Counters().add([ForeignCommand(12.0)])
    after = before.add([ForeignCommand(12.0), SetpointRefused(0.3, 0.0, 0.1)])
    assert after.counts == {Counted.FOREIGN_COMMAND: 2, Counted.SETPOINT_REFUSED: 1}
    assert before.counts == {Counted.FOREIGN_COMMAND: 1}


def test_nothing_is_told_while_nothing_is_counted() -> None:
    counters = Counters()
    assert counters.next_told() == (counters, None)


def test_the_counts_are_told_in_turn_and_a_new_one_takes_its_place() -> None:
    counters = Counters().add([ForeignCommand(12.0), FrameRefused(Reason.WRONG_CRC, ""), LawLate(1, 0.001)])
    told = []
    for turn in range(7):
        if turn == 4:
            counters = counters.add([FrameRefused(Reason.REPEATED, ""), FrameRefused(Reason.WRONG_CRC, "")])
        counters, message = counters.next_told()
        told.append(message)
    assert told == [
        PositionerCount(Counted.WRONG_CRC, 1),
        PositionerCount(Counted.FOREIGN_COMMAND, 1),
        PositionerCount(Counted.LAW_LATE, 1),
        PositionerCount(Counted.WRONG_CRC, 1),
        PositionerCount(Counted.REPEATED, 1),
        PositionerCount(Counted.FOREIGN_COMMAND, 1),
        PositionerCount(Counted.LAW_LATE, 1),
    ]


def test_a_count_wraps_where_its_signal_does() -> None:
    for count, told in ((2**32 - 1, 2**32 - 1), (2**32, 0), (2**32 + 5, 5)):
        assert Counters({Counted.LOST: count}).next_told()[1] == PositionerCount(Counted.LOST, told)


def test_lines_of_the_log_are_told_apart_by_their_cause() -> None:
    assert kind_of(FrameRefused(Reason.WRONG_CRC, "")) == "FrameRefused wrong CRC"
    assert kind_of(FeedbackRefused(0.3, "", Counted.FEEDBACK_JUMP)) == "FeedbackRefused FEEDBACK_JUMP"
    assert kind_of(ForeignCommand(12.0)) == "ForeignCommand"
