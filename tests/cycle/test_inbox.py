"""From frames to their meaning: what is accepted, what is refused, and why."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from positioner.cycle.events import (
    FeedbackRefused,
    ForeignCommand,
    FrameRefused,
    FramesLost,
    OrderDisputed,
    SetpointRefused,
)
from positioner.cycle.inbox import receive
from positioner.cycle.link import LinkState, Reading, Received
from positioner.cycle.timing_events import PeriodWrong
from positioner.guard.settings import GuardSettings
from positioner.guard.stall import Freshness
from positioner.guard.state import Arming, GuardInput, GuardState, LastReceived
from positioner.guard.supervisor import supervise
from positioner.valve.parameters import ValveParameters
from positioner.wire.codec import make_codec
from positioner.wire.e2e import protect
from positioner.wire.messages import (
    ActuatorState,
    CanFrame,
    Cause,
    Counted,
    CurrentCommand,
    Health,
    HostRequest,
    ManualCurrent,
    ManualRequest,
    Mode,
    PlantTruth,
    PositionerStatus,
    Quality,
    Setpoint,
    StemPosition,
)
from positioner.wire.settings import MessageSettings, WireSettings

if TYPE_CHECKING:
    from pathlib import Path

CODEC = make_codec()
GUARD = GuardSettings(max_jump_m=0.01, position_margin_m=0.02)
VALVE = ValveParameters(id="paper")


def position(position_m: float, counter: int, echo: int = 0, quality: Quality = Quality.VALID) -> CanFrame:
    return CODEC.encode(StemPosition(position_m, echo, quality), counter)


def setpoint(setpoint_m: float, counter: int, request: HostRequest = HostRequest.NONE) -> CanFrame:
    return CODEC.encode(Setpoint(setpoint_m, request), counter)


def take(*frames: CanFrame, link: LinkState | None = None) -> Received:
    return receive(CODEC, GUARD, VALVE, link or LinkState(), frames)


def reasons(received: Received) -> list[Counted]:
    return [event.counted for event in received.events if isinstance(event, FrameRefused)]


def test_a_reading_comes_with_its_counters() -> None:
    received = take(position(0.08, 7, echo=42))
    assert received.reading == Reading(0.08, 7, 42, 1)
    assert received.guard_input.feedback_age_ns is not None
    assert received.link.feedback.readings.position_m == 0.08
    assert received.events == ()


def test_without_frames_nothing_changes() -> None:
    received = take()
    assert received.reading is None
    assert received.guard_input == GuardInput()
    assert received.link == LinkState()


def test_the_time_between_two_readings_counts_towards_a_frozen_one() -> None:
    tuning, link = GuardSettings(frozen_s=0.875), LinkState()
    # from the first one 4, 3 and 1 periods, lost frames included: 0.5, 0.875 and 1 s
    for counter, frozen in ((0, False), (4, False), (7, False), (8, True)):
        received = receive(CODEC, tuning, VALVE, link, (position(0.05, counter),), 20.0, 0.125)
        link = received.link
        assert received.guard_input.feedback_refused is (Cause.FEEDBACK_FROZEN if frozen else None)
        assert (received.guard_input.feedback_age_ns is not None) is not frozen
    assert link.feedback.readings.rigid_s == 1.0
    (event,) = received.events
    assert isinstance(event, FeedbackRefused)
    assert event.counted is Counted.FEEDBACK_FROZEN


def test_without_a_period_or_a_command_no_time_is_counted() -> None:
    frames = tuple(position(0.05, counter) for counter in range(5))
    assert receive(CODEC, GUARD, VALVE, LinkState(), frames, 20.0).link.feedback.readings.rigid_s == 0.0
    assert receive(CODEC, GUARD, VALVE, LinkState(), frames, None, 10.0).link.feedback.readings.rigid_s == 0.0


def test_a_backlog_is_drained_to_the_newest_reading_and_its_time_counted() -> None:
    received = take(*(position(0.08 + 0.0001 * i, i) for i in range(5)))
    assert received.reading is not None
    assert received.reading.position_m == pytest.approx(0.0804)
    assert (received.reading.counter, received.reading.periods) == (4, 5)


def test_lost_frames_are_reported_and_count_as_time() -> None:
    link = take(position(0.08, 254)).link
    received = take(position(0.08, 1), link=link)
    assert received.reading is not None
    assert received.reading.periods == 3
    assert received.events == (FramesLost("StemPosition", count=2),)


def test_the_time_of_refused_readings_is_not_lost() -> None:
    link = take(position(0.08, 0)).link
    for counter in (1, 2):
        received = take(position(0.08, counter, quality=Quality.FAULT), link=link)
        assert received.reading is None
        link = received.link
    received = take(position(0.08, 3), position(0.08, 4), position(0.08, 5, quality=Quality.FAULT), link=link)
    assert received.reading is not None
    assert (received.reading.counter, received.reading.periods) == (4, 4)
    last = take(position(0.08, 6), link=received.link)
    assert last.reading is not None
    assert last.reading.periods == 2


def test_a_repeated_frame_is_refused() -> None:
    link = take(position(0.08, 7)).link
    received = take(position(0.081, 7), link=link)
    assert received.reading is None
    assert reasons(received) == [Counted.REPEATED]
    assert str(received.events[0]) == "frame refused: repeated counter: StemPosition counter 7 after 7"
    assert received.link.feedback.readings.position_m == 0.08


def test_an_old_frame_is_refused_and_a_restarted_sensor_believed_at_its_third_frame() -> None:
    link = take(position(0.08, 7)).link
    stale = take(position(0.08, 3), link=link)
    assert stale.reading is None
    assert reasons(stale) == [Counted.OUT_OF_ORDER]
    restarted = take(position(0.08, 4), link=stale.link)
    assert restarted.reading is None
    assert reasons(restarted) == []
    assert restarted.guard_input.feedback_refused is None  # one frame out of sequence is no dispute
    (event,) = restarted.events
    assert isinstance(event, FeedbackRefused)
    assert (event.counted, event.why.partition(":")[0]) == (Counted.DISPUTED, "its sender is in doubt")
    again = take(position(0.08, 5), link=restarted.link)
    assert again.reading == Reading(0.08, 5, 0, 2)  # the time of its second frame is not lost


def test_a_restarted_host_is_believed_at_its_second_frame() -> None:
    link = take(setpoint(0.07, 7)).link
    stale = take(setpoint(0.08, 3, HostRequest.ARM), link=link)
    assert reasons(stale) == [Counted.OUT_OF_ORDER]
    assert (stale.guard_input.requests, stale.link.setpoint.position_m) == ((), 0.07)
    restarted = take(setpoint(0.08, 4, HostRequest.ARM), link=stale.link)
    assert (restarted.guard_input.requests, restarted.link.setpoint.position_m) == ((HostRequest.ARM,), 0.08)


def test_two_sensors_under_one_identifier_are_disputed_and_no_feedback() -> None:
    link = take(position(0.08, 0)).link
    for counter in range(1, 40):
        received = take(position(0.08, counter), position(0.12, counter + 100), link=link)
        link = received.link
        assert received.reading is None or counter == 1
        assert received.guard_input.feedback_refused is (None if counter <= 4 else Cause.FEEDBACK_DISPUTED)
    assert link.feedback.readings.position_m == 0.08
    (disputed,) = (event for event in received.events if isinstance(event, FeedbackRefused))
    assert disputed.counted is Counted.DISPUTED
    assert disputed.why.startswith("disputed: 32 of the last 64 frames came out of sequence; a second sender")
    alone = take(*(position(0.08, counter) for counter in range(40, 56)), link=link)
    assert (alone.reading and alone.reading.counter) == 55


def test_two_hosts_under_one_identifier_are_disputed_and_only_their_disarm_counts() -> None:
    link = take(setpoint(0.07, 0)).link
    for counter in range(1, 10):
        received = take(setpoint(0.07, counter, HostRequest.ARM), setpoint(0.09, counter + 100), link=link)
        link = received.link
        assert (received.guard_input.setpoint_age_ns is not None) is (counter < 5)
        assert received.guard_input.setpoint_refused is (None if counter < 5 else Cause.SETPOINT_DISPUTED)
        assert received.guard_input.requests == ((HostRequest.ARM,) if counter < 5 else ())
    assert link.setpoint.position_m == 0.07
    disputed = received.events[0]
    assert isinstance(disputed, OrderDisputed)
    assert str(disputed).startswith("setpoint 70.000 mm refused: disputed: 8 of the last 64 frames")
    disarm, other = setpoint(0.07, 10, HostRequest.DISARM), setpoint(0.07, 11)
    assert take(disarm, link=link).guard_input.stray_disarm
    assert take(disarm, other, link=link).guard_input.stray_disarm
    assert not take(other, link=link).guard_input.stray_disarm


@pytest.mark.parametrize("age_ns", [-1, 0, 1])
def test_a_request_that_waited_for_too_long_does_not_count_but_to_disarm(age_ns: int) -> None:
    fresh = Freshness(now_ns=2000, orders_since_ns=1000.0)
    for request in HostRequest:
        frame = replace(setpoint(0.07, 1, request), received_ns=1000 - age_ns)
        seen = receive(CODEC, GUARD, VALVE, LinkState(), (frame,), fresh=fresh).guard_input
        waited = age_ns > 0 and request is not HostRequest.DISARM
        assert seen.requests == (() if waited else (request,))
        assert seen.waiting_request is (request if waited else None)


@pytest.mark.parametrize("age_ns", [-1, 0, 1])
def test_a_current_by_hand_that_waited_for_too_long_does_not_count_but_the_end_of_manual_mode_does(age_ns: int) -> None:
    fresh = Freshness(now_ns=2000, orders_since_ns=1000.0)
    for request in ManualRequest:
        message = ManualCurrent(9.5, request)
        frame = replace(CODEC.encode(message, 1), received_ns=1000 - age_ns)
        seen = receive(CODEC, GUARD, VALVE, LinkState(), (frame,), fresh=fresh).guard_input
        assert seen.manual == (None if age_ns > 0 and request is ManualRequest.MANUAL else message)


def test_two_hosts_that_give_currents_by_hand_are_both_refused() -> None:
    link = take(CODEC.encode(ManualCurrent(9.5), 0)).link
    for counter in range(1, 10):
        frames = CODEC.encode(ManualCurrent(9.5), counter), CODEC.encode(ManualCurrent(14.0), counter + 100)
        received = take(*frames, link=link)
        link = received.link
        assert received.guard_input.manual == (ManualCurrent(9.5) if counter < 5 else None)
    assert str(received.events[0]).startswith("current 9.500 mA by hand refused: disputed: 8 of the last 64 frames")


@pytest.mark.parametrize("counter", range(256))
def test_an_intact_disarm_is_obeyed_whatever_its_counter(counter: int) -> None:
    link = take(setpoint(0.07, 100, HostRequest.ARM)).link
    received = take(setpoint(0.07, counter, HostRequest.DISARM), link=link)
    in_sequence = 101 <= counter <= 111
    assert received.guard_input.requests == ((HostRequest.DISARM,) if in_sequence else ())
    assert received.guard_input.stray_disarm is not in_sequence
    assert reasons(received) == []
    if not in_sequence:
        line = f"a DISARM that is not of the host in sequence (counter {counter} after 100) is obeyed"
        assert [str(event) for event in received.events] == [line]
        assert received.link.setpoint.position_m == 0.07
        assert received.link.senders[Setpoint].window == link.senders[Setpoint].window
    for other in (HostRequest.NONE, HostRequest.ARM):
        assert not take(setpoint(0.07, counter, other), link=link).guard_input.stray_disarm


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize("at_once", [1, 2, 3])
def test_disarms_with_the_counters_of_a_host_that_goes_on_leave_its_sequence_alone(late: int, at_once: int) -> None:
    link = take(setpoint(0.07, 0)).link
    for counter in range(1, 600):
        heard = [setpoint(0.09, counter - late, HostRequest.DISARM)] * at_once
        received = take(setpoint(0.07, counter), *heard, link=link)
        link = received.link
        assert received.guard_input.stray_disarm
        assert (reasons(received), received.guard_input.setpoint_refused) == ([], None)
        assert (link.setpoint.position_m, link.setpoint.counter) == (0.07, counter % 256)
    assert link.senders[Setpoint].window.errors == 0


def test_a_damaged_disarm_is_not_obeyed() -> None:
    assert take(damaged(setpoint(0.07, 1, HostRequest.DISARM))).guard_input == GuardInput()


def test_every_sender_has_its_own_counter() -> None:
    received = take(position(0.08, 7), setpoint(0.07, 7), CODEC.encode(ActuatorState(4e4), 7))
    assert reasons(received) == []
    assert received.link.pressure_pa == pytest.approx(4e4)
    assert (received.link.setpoint.position_m, received.link.setpoint.counter) == (0.07, 7)
    again = take(CODEC.encode(ActuatorState(5e4), 7), link=received.link)
    assert reasons(again) == [Counted.REPEATED]
    assert again.link.pressure_pa == pytest.approx(4e4)


def test_a_setpoint_of_the_travels_ends_is_taken() -> None:
    for wanted_m in (VALVE.travel_min_m, VALVE.travel_max_m):
        received = take(setpoint(wanted_m, 1))
        assert received.guard_input.setpoint_age_ns is not None
        assert received.link.setpoint.position_m == pytest.approx(wanted_m)


@pytest.mark.parametrize("wanted_m", [-0.00001, 0.13971, 1.3])
def test_a_setpoint_outside_the_travel_is_refused_and_the_last_one_stays(wanted_m: float) -> None:
    link = take(setpoint(0.07, 1)).link
    received = take(setpoint(wanted_m, 2, HostRequest.ARM), link=link)
    assert received.guard_input.setpoint_age_ns is None
    assert (received.link.setpoint.position_m, received.link.setpoint.counter) == (0.07, 1)
    (event,) = received.events
    assert isinstance(event, SetpointRefused)
    assert event.setpoint_m == pytest.approx(wanted_m)
    assert "outside the travel of 0 to 139.7 mm" in str(event)
    assert received.guard_input.requests == ()  # an ARM counts with a setpoint that can be used
    disarmed = take(setpoint(wanted_m, 2, HostRequest.DISARM), link=link)
    assert disarmed.guard_input.requests == (HostRequest.DISARM,)  # a DISARM always counts


def test_the_newest_setpoint_of_a_batch_counts_and_its_requests_keep_their_order() -> None:
    arm, none = HostRequest.ARM, HostRequest.NONE
    asked = [arm, arm, none, arm, none, none]
    received = take(*(setpoint(0.07 + 1e-3 * number, number, request) for number, request in enumerate(asked)))
    assert received.link.setpoint.position_m == pytest.approx(0.075)
    assert received.guard_input.requests == (arm, none, arm, none)


def test_a_request_to_disarm_is_not_cancelled_by_a_later_frame_of_the_batch() -> None:
    for later in (HostRequest.NONE, HostRequest.ARM):
        received = take(setpoint(0.07, 1, HostRequest.DISARM), setpoint(0.07, 2, later))
        armed = GuardState(
            mode=Mode.ACTIVE,
            arming=Arming(armed=True, ever_armed=True, request=HostRequest.ARM),
            last=LastReceived(feedback_ns=0),
        )
        state = supervise(GuardSettings(), armed, received.guard_input, 0.001, 0)
        assert not state.arming.armed


@pytest.mark.parametrize("position_m", [-0.0201, 0.1598, 1.3])
def test_a_reading_beyond_travel_and_margin_is_refused(position_m: float) -> None:
    received = take(position(position_m, 1))
    assert received.reading is None
    assert received.guard_input.feedback_age_ns is None
    (event,) = received.events
    assert isinstance(event, FeedbackRefused)
    assert "outside the travel (-20 to 159.7 mm" in event.why
    assert event.counted is Counted.FEEDBACK_RANGE
    assert received.guard_input.feedback_refused is Cause.FEEDBACK_IMPLAUSIBLE


@pytest.mark.parametrize("position_m", [-0.0199, 0.1596])
def test_noise_may_reach_beyond_a_hard_stop_by_the_margin(position_m: float) -> None:
    assert take(position(position_m, 1)).reading is not None


def test_a_reading_of_quality_fault_is_refused_and_a_suspect_one_accepted() -> None:
    faulty = take(position(0.08, 1, quality=Quality.FAULT))
    assert faulty.reading is None
    assert [str(event) for event in faulty.events] == ["position 80.000 mm refused: the sensor reports a fault"]
    assert take(position(0.08, 1, quality=Quality.SUSPECT)).reading is not None


def test_a_jump_is_refused_twice_and_believed_the_third_time() -> None:
    link = take(position(0.08, 0)).link
    for counter in (1, 2):
        received = take(position(0.0901, counter), link=link)
        assert received.reading is None
        assert "a jump of 10.1 mm" in str(received.events[0])
        link = received.link
    received = take(position(0.0901, 3), link=link)
    assert received.reading is not None
    assert (received.link.feedback.readings.position_m, received.link.feedback.readings.jumps) == (0.0901, 0)


def test_a_single_outlier_is_forgotten() -> None:
    link = take(position(0.08, 0), position(0.0901, 1), position(0.08, 2)).link
    assert (link.feedback.readings.jumps, link.feedback.readings.position_m) == (0, 0.08)
    assert take(position(0.0899, 3), link=link).reading is not None


def damaged(frame: CanFrame) -> CanFrame:
    return replace(frame, data=frame.data[:4] + bytes([frame.data[4] ^ 0x10]) + frame.data[5:])


def badly_made(payload: str) -> CanFrame:
    """Return a STEM_POSITION frame with `payload` after a valid CRC: the mistake is the sender's."""
    frame = position(0.08, 1)
    return replace(frame, data=protect(frame.data[:2] + bytes.fromhex(payload), 7952))


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (damaged(position(0.08, 1)), Counted.WRONG_CRC),
        (replace(position(0.08, 1), data=position(0.08, 1).data[:7]), Counted.WRONG_LENGTH),
        (replace(position(0.08, 1), data=b""), Counted.WRONG_LENGTH),
        (replace(position(0.08, 1), is_error=True), Counted.ERROR_FRAME),
        (replace(position(0.08, 1), is_remote=True, data=b""), Counted.REMOTE_FRAME),
        (badly_made("01 ffffff 07 00"), Counted.OUT_OF_RANGE),
        (badly_made("01 00127a 00 90"), Counted.UNDEFINED_VALUE),
    ],
)
def test_a_bad_frame_is_refused_counted_and_reported(frame: CanFrame, reason: Counted) -> None:
    received = take(frame)
    assert received.reading is None
    assert reasons(received) == [reason]
    assert received.link.feedback.readings.position_m is None
    assert reason.text in str(received.events[0])


def test_a_bad_frame_costs_no_other_frame_of_its_batch() -> None:
    received = take(damaged(position(0.08, 1)), position(0.08, 2), damaged(position(0.08, 3)), setpoint(0.07, 1))
    assert received.reading is not None
    assert received.guard_input.setpoint_age_ns is not None
    assert len(reasons(received)) == 2


def test_the_traffic_of_other_nodes_is_no_error() -> None:
    received = take(CanFrame(0x7DF, b"\x02\x01\x0c"), replace(position(0.08, 1), is_extended=True))
    assert received.events == ()
    assert received.link == LinkState()


def test_the_truth_of_the_emulator_and_another_status_are_not_read() -> None:
    truth = CODEC.encode(PlantTruth(0.08, 0.1), 1)
    status = CODEC.encode(PositionerStatus(Mode.ACTIVE, Cause.NONE, Health.GOOD, True, True, 0, 0, 0), 1)
    received = take(truth, status)
    assert received.reading is None
    assert received.events == ()
    assert received.link == LinkState()


def test_a_command_of_another_controller_is_found_whatever_its_counter() -> None:
    frame = CODEC.encode(CurrentCommand(12.5), 9)
    for _ in range(2):
        received = take(frame)
        assert received.guard_input.foreign_command
        (event,) = received.events
        assert isinstance(event, ForeignCommand)
        assert event.current_ma == 12.5
        assert "another controller commands this valve (12.500 mA)" in str(received.events[0])


FLOAT_DBC = """VERSION ""
BU_: A B
BO_ 512 POS: 4 A
 SG_ Pos : 0|32@1- (1,0) [0|0] "m" B
BO_ 513 SP: 4 A
 SG_ Set : 0|32@1- (1,0) [0|0] "m" B
SIG_VALTYPE_ 512 Pos : 1;
SIG_VALTYPE_ 513 Set : 1;
"""


def test_a_foreign_frame_without_counter_that_carries_no_number_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "float.dbc"
    path.write_text(FLOAT_DBC, encoding="utf-8")
    codec = make_codec(
        WireSettings(
            dbc=path,
            stem_position=MessageSettings(message="POS", signals={"position_m": "Pos"}),
            setpoint=MessageSettings(message="SP", signals={"setpoint_m": "Set"}),
        )
    )
    nan = bytes.fromhex("0000c07f")
    received = receive(codec, GUARD, VALVE, LinkState(), (CanFrame(512, nan), CanFrame(513, nan)))
    assert received.reading is None
    assert received.guard_input.setpoint_age_ns is None
    assert reasons(received) == [Counted.OUT_OF_RANGE] * 2
    fine = codec.encode(StemPosition(0.08), 0)
    received = receive(codec, GUARD, VALVE, LinkState(), (fine, fine))
    assert received.reading is not None
    assert received.reading == Reading(received.reading.position_m, None, None, 2)
    assert received.reading.position_m == pytest.approx(0.08)


# what is handed on, and kept for the next batch


def test_the_counter_of_the_last_reading_that_was_used_is_kept() -> None:
    used = take(position(0.08, 7))
    assert used.link.feedback.counter == 7
    refused = take(position(0.08, 8, quality=Quality.FAULT), link=used.link)
    assert refused.link.feedback.counter == 7
    assert take(position(0.08, 9), link=refused.link).link.feedback.counter == 9


def test_a_position_frame_that_the_bus_doubles_is_repeated_and_no_second_sender() -> None:
    link = take(position(0.08, 1)).link
    for counter in range(2, 100):
        received = take(position(0.08, counter), position(0.08, counter), link=link)
        link = received.link
        assert received.reading is not None
        assert reasons(received) == [Counted.REPEATED]


def test_a_command_of_another_controller_is_handed_on_with_its_counter() -> None:
    assert take(CODEC.encode(CurrentCommand(12.5), 77)).events == (ForeignCommand(12.5, 77),)


def test_a_disputed_reading_is_refused_with_its_position() -> None:
    link = take(position(0.08, 0)).link
    received = take(position(0.08, 50), position(0.12, 51), link=link)
    assert [event.position_m for event in received.events if isinstance(event, FeedbackRefused)] == [
        pytest.approx(0.12)
    ]


@pytest.mark.parametrize("quality", [Quality.VALID, Quality.SUSPECT, Quality.FAIL_POSITION])
def test_a_reading_says_whether_the_actuator_obeys(quality: Quality) -> None:
    reading = take(position(0.08, 1, quality=quality)).reading
    assert reading == Reading(0.08, 1, 0, 1, obeys=quality is not Quality.FAIL_POSITION)


@pytest.mark.parametrize(("arrived_ns", "used"), [(999, False), (1000, True), (1001, True)])
def test_a_reading_that_waited_for_too_long_is_feedback_but_not_acted_on(arrived_ns: int, used: bool) -> None:
    frame = replace(position(0.08, 1), received_ns=arrived_ns)
    fresh = Freshness(now_ns=2000, readings_since_ns=1000.0)
    received = receive(CODEC, GUARD, VALVE, LinkState(), (frame,), fresh=fresh)
    assert (received.reading is not None) is used
    assert received.guard_input.feedback_age_ns == 2000 - arrived_ns


def test_a_wrong_period_is_reported_once_for_each_window_that_measures_another() -> None:
    link, reported = LinkState(), []
    for counter in range(1, 160):
        period_ns = 2_000_000 if counter <= 101 else 3_000_000
        now_ns = 10**9 + counter * period_ns
        frame = replace(position(0.08, counter % 256), received_ns=now_ns)
        received = receive(CODEC, GUARD, VALVE, link, (frame,), period_s=0.001, fresh=Freshness(now_ns=now_ns))
        link = received.link
        reported += [(counter, event) for event in received.events if isinstance(event, PeriodWrong)]
    assert reported == [(51, PeriodWrong(0.002, 0.001)), (151, PeriodWrong(0.003, 0.001))]


def test_two_sensors_that_count_alike_are_disputed_by_their_bytes() -> None:
    link = take(position(0.08, 0)).link
    for counter in range(1, 10):
        received = take(position(0.08, counter), position(0.12, counter), link=link)
        link = received.link
    assert received.guard_input.feedback_refused is Cause.FEEDBACK_DISPUTED


def test_a_stray_disarm_is_not_undone_by_another_frame_out_of_sequence() -> None:
    link = take(setpoint(0.07, 100)).link
    received = take(setpoint(0.07, 50, HostRequest.DISARM), setpoint(0.07, 30), link=link)
    assert received.guard_input.stray_disarm


def pressure(pressure_pa: float, counter: int) -> CanFrame:
    return CODEC.encode(ActuatorState(pressure_pa), counter)


def test_a_pressure_is_new_for_one_reading_only() -> None:
    alone = take(pressure(5e4, 0))
    first = take(position(0.08, 0), link=alone.link)
    second = take(position(0.08, 1), link=first.link)
    third = take(pressure(6e4, 1), position(0.08, 2), link=second.link)

    assert alone.reading is None
    readings = [each.reading for each in (first, second, third)]
    assert [reading is not None and reading.pressure_is_new for reading in readings] == [True, False, True]
    assert second.link.pressure_pa == pytest.approx(5e4)
