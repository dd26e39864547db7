"""Two senders under one identifier, and a request to disarm out of sequence, seen by the daemon on a bus."""

from __future__ import annotations

from typing import TYPE_CHECKING

from daemon_helpers import HERE_M, Loop

from positioner.machine.journal import Throttle
from positioner.wire.messages import (
    Cause,
    CurrentCommand,
    Health,
    HostRequest,
    Mode,
    PositionerStatus,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.wire.messages import CanFrame, Message


def last_status(sent: list[Message]) -> PositionerStatus:
    return [message for message in sent if isinstance(message, PositionerStatus)][-1]


def second(loop: Loop, message: StemPosition | Setpoint, counter: int) -> CanFrame:
    """The frame of another sender that counts for itself."""
    return loop.others.codec.encode(message, counter)


def test_a_second_sensor_under_the_identifier_of_the_first_is_reported_and_neither_moves_the_valve(
    tmp_path: Path,
) -> None:
    with Loop(tmp_path, guard={"max_jump_m": 0.1}) as loop:
        loop.session.announcer.throttle = Throttle(0.0)  # every line
        loop.request(HostRequest.ARM)
        loop.sample()
        sent: list[Message] = []
        for counter in range(150, 180):
            # its counter is far ahead; one frame of the first sensor is lost, so that two of the second are neighbours
            lost = loop.others.frame(StemPosition(HERE_M))
            first = () if counter == 160 else (lost,)
            setpoint = loop.others.frame(Setpoint(HERE_M))
            sent += loop.cycle(*first, second(loop, StemPosition(HERE_M + 0.04), counter), setpoint)
        assert loop.session.state.link.feedback.readings.position_m == HERE_M
        status = last_status(sent)
        assert (status.mode, status.cause, status.health) == (Mode.FAILSAFE, Cause.FEEDBACK_DISPUTED, Health.FAILURE)
        assert loop.logged("mode ACTIVE -> HOLD (feedback disputed)")
        assert loop.logged("a second sender under its identifier? stop one of them")
        # alone again it is believed, and can be armed
        for _ in range(17):
            loop.sample()
        sent = [*loop.request(HostRequest.ARM), *(message for _ in range(6) for message in loop.sample())]
        assert last_status(sent).mode is Mode.ACTIVE


def test_a_second_host_under_the_identifier_of_the_first_is_reported_and_moves_nothing(tmp_path: Path) -> None:
    with Loop(tmp_path) as loop:
        loop.request(HostRequest.ARM)
        sent: list[Message] = []
        for counter in range(150, 200):
            setpoints = second(loop, Setpoint(HERE_M + 0.005), counter), loop.others.frame(Setpoint(HERE_M))
            sent += loop.cycle(*setpoints, loop.others.frame(StemPosition(HERE_M, loop.others.acting)))
        assert loop.session.state.link.setpoint.position_m == HERE_M
        status = last_status(sent)
        assert (status.mode, status.cause) == (Mode.HOLD, Cause.SETPOINT_DISPUTED)
        assert status.health is Health.OUT_OF_SPECIFICATION


def test_a_disarm_of_any_counter_silences(tmp_path: Path) -> None:
    with Loop(tmp_path) as loop:
        for counter in (0, 77, 200):
            loop.request(HostRequest.ARM)
            loop.sample()
            sent = [*loop.sample(), *loop.cycle(second(loop, Setpoint(HERE_M, HostRequest.DISARM), counter))]
            assert any(isinstance(message, CurrentCommand) for message in sent)
            assert not [message for message in loop.sample() if isinstance(message, CurrentCommand)]
            assert loop.session.state.guard.mode is Mode.READY
        assert loop.logged("is obeyed")
