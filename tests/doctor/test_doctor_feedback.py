"""The doctor on live feedback: rate, absence, and what came instead."""

from __future__ import annotations

from dataclasses import replace

import pytest

from positioner.bus.address import BusAddress
from positioner.doctor import feedback
from positioner.doctor.feedback import BusTraffic
from positioner.doctor.finding import Level
from positioner.wire.codec import make_codec
from positioner.wire.messages import CanFrame, Quality, StemPosition

CODEC = make_codec()


def traffic(*frames: CanFrame) -> BusTraffic:
    made = BusTraffic()
    made.add(CODEC, frames)
    return made


def at(frame: CanFrame, number: int, period_s: float = 0.001) -> CanFrame:
    return replace(frame, received_ns=round(1e9 + number * period_s * 1e9))


READINGS = [at(CODEC.encode(StemPosition(0.08), number), number) for number in range(200)]
CAN0 = BusAddress(channel="can0")


@pytest.mark.parametrize(("period_s", "level"), [(0.001, Level.OK), (0.0011, Level.OK), (0.002, Level.WARN)])
def test_the_rate_is_measured_and_held_against_the_configuration(period_s: float, level: Level) -> None:
    finding = feedback.assessed(traffic(*READINGS), CAN0, period_s)
    assert finding.level is level
    assert finding.text.startswith("stem at 80.00 mm, 1000 frames/s")
    assert ("control.sample_period_s" in finding.text) is (level is Level.WARN)


def test_a_slow_sensor_is_no_fault_where_it_is_configured_so() -> None:
    assert feedback.assessed(traffic(*READINGS[:2]), CAN0, 0.5).level is Level.OK
    assert feedback.assessed(traffic(*READINGS[:2]), CAN0, 0.001).level is Level.WARN


@pytest.mark.parametrize(
    ("frames", "text"),
    [
        ([], "the bus is silent"),
        ([CanFrame(0x7FF, b""), CanFrame(0x123, b"1"), CanFrame(0x123, b"2")],
         "3 frames with other identifiers came: 123, 7FF"),
        ([CanFrame(0x110, bytes(8))], "1 frames were refused: wrong CRC: STEM_POSITION"),
        ([CanFrame(0x110, b"1")], "1 frames were refused: wrong length"),
        ([CanFrame(4, bytes(8), is_error=True)], "1 frames were refused: error frame"),
        ([CODEC.encode(StemPosition(0.08, 0, Quality.FAULT), 0)], "the sensor reports a fault in 1 frames"),
    ],
)  # fmt: skip
def test_frames_that_came_instead_of_feedback_are_reported(frames: list[CanFrame], text: str) -> None:
    finding = feedback.assessed(traffic(*frames), CAN0, 0.001)
    assert finding.level is Level.FAIL
    assert finding.text.startswith(f"no valid position frame in 1 s; {text}")
    assert finding.fix.startswith("candump -tz can0")
