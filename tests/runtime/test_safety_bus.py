"""The port on a bus that carries too many frames, and on one that takes none."""

from __future__ import annotations

import errno
from typing import TYPE_CHECKING

import can
import pytest

from positioner.bus import port as bus_module
from positioner.bus.address import BusAddress
from positioner.bus.events import Overrun, SendFailed
from positioner.bus.port import BusPort
from positioner.wire.messages import CanFrame

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.bus.events import BusEvent

WANTED, UNWANTED = 0x110, 0x7DF
BATCH = 1024


class Flood:
    """A bus on which a frame always waits, until `count` have been read; it takes frames unless its buffer is full."""

    def __init__(self, identifiers: tuple[int, ...] = (), count: int = 0) -> None:
        self.identifiers = identifiers
        self.count = count
        self.read = 0
        self.full = False
        self.sent: list[int] = []

    def recv(self, timeout_s: float) -> can.Message | None:
        del timeout_s
        if self.read == self.count:
            return None
        self.read += 1
        return can.Message(
            arbitration_id=self.identifiers[self.read % len(self.identifiers)],
            data=self.read.to_bytes(2, "big"),
            is_extended_id=False,
        )

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        assert timeout is not None
        assert 0.0 < timeout <= 0.1
        if self.full:
            raise can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)
        self.sent.append(message.arbitration_id)

    def shutdown(self) -> None:
        pass


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Callable[[Flood], tuple[BusPort, list[BusEvent]]]:
    """Return how to put a port on such a bus; the list holds what it reports."""

    def put(flood: Flood) -> tuple[BusPort, list[BusEvent]]:
        monkeypatch.setattr(bus_module, "open_bus", lambda _address, _wanted: flood)
        events: list[BusEvent] = []
        return BusPort(BusAddress(channel="can7"), [(WANTED, False)], events.append), events

    return put


@pytest.mark.parametrize("identifiers", [(WANTED,), (UNWANTED,), (WANTED, UNWANTED)])
def test_a_flood_is_taken_in_batches_of_at_most_1024_frames_between_which_a_cycle_closes(
    identifiers: tuple[int, ...], wire: Callable[[Flood], tuple[BusPort, list[BusEvent]]]
) -> None:
    flood = Flood(identifiers, count=5 * BATCH // 2)
    port, _ = wire(flood)
    read: list[int] = [0]
    taken: list[CanFrame] = []
    for _ in range(3):
        taken += port.receive(0.01)
        read.append(flood.read)
    assert read == [0, BATCH, 2 * BATCH, 5 * BATCH // 2]
    numbers = [int.from_bytes(frame.data, "big") for frame in taken]
    assert numbers == [n for n in range(1, flood.count + 1) if identifiers[n % len(identifiers)] == WANTED]


def test_a_frame_that_the_bus_does_not_take_is_reported_once_and_the_next_one_is_sent(
    wire: Callable[[Flood], tuple[BusPort, list[BusEvent]]],
) -> None:
    flood = Flood()
    port, events = wire(flood)
    port.open()
    flood.full = True
    assert [port.send(CanFrame(0x100, bytes(8))) for _ in range(5)] == [False] * 5
    flood.full = False
    assert port.send(CanFrame(0x101, bytes(8)))
    assert flood.sent == [0x101]
    assert port.is_open
    (event,) = events
    assert isinstance(event, SendFailed)
    assert "did not take a frame: Failed to transmit: No buffer space available" in str(event)
    flood.full = True
    assert not port.send(CanFrame(0x102, bytes(8)))
    assert events == [event, event]


def test_frames_that_the_receive_queue_dropped_are_counted_and_reported(
    wire: Callable[[Flood], tuple[BusPort, list[BusEvent]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    port, events = wire(Flood())
    dropped = iter([0, 3, 3, 5])
    monkeypatch.setattr(bus_module, "dropped_frames", lambda _bus: next(dropped))
    reported = []
    for _ in range(4):
        port.receive(0.0)
        reported.append(len(events))
    assert reported == [0, 1, 1, 2]
    assert events == [Overrun(port.address, 3), Overrun(port.address, 5)]
    assert "3 frame(s) lost so far" in str(events[0])
