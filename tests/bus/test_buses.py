"""One wait for several ports: whoever has a frame is read at once, and the others are not kept waiting."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import can
import pytest

from positioner.bus.address import BusAddress
from positioner.bus.buses import Buses
from positioner.bus.port import BusPort, Ports
from positioner.machine.time import Instant, MachineTime

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


class PipeBus:
    """A bus whose frames come through a pipe, so that it can be waited for; `looks` counts the reads."""

    def __init__(self) -> None:
        self.reader, self.writer = os.pipe()
        os.set_blocking(self.reader, False)
        self.looks = 0
        self.is_cut = False

    def fileno(self) -> int:
        return self.reader

    def put(self, identifier: int) -> None:
        os.write(self.writer, bytes([identifier]))

    def recv(self, timeout: float | None) -> can.Message | None:
        del timeout
        self.looks += 1
        if self.is_cut:
            raise can.CanOperationError("Network is down", 100)
        try:
            (identifier,) = os.read(self.reader, 1)
        except BlockingIOError:
            return None
        return can.Message(arbitration_id=identifier, is_extended_id=False)

    def shutdown(self) -> None:
        pass


class Rig:
    def __init__(self) -> None:
        self.made = {name: PipeBus() for name in ("a", "b", "c")}
        self.ports = [
            BusPort(BusAddress(interface="virtual", channel=name), ports=Ports(open_bus=self.open))
            for name in self.made
        ]
        self.buses = Buses(self.ports, MachineTime())

    def open(self, address: BusAddress, _wanted: Iterable[tuple[int, bool]]) -> Any:
        bus = self.made[address.channel]
        if bus.is_cut:
            raise OSError(19, "No such device")
        return bus

    def receive(self, timeout_s: float = 5.0) -> list[list[int]]:
        found: list[list[int]] = [[], [], []]
        for number, frames in self.buses.receive(timeout_s):
            found[number] += [frame.arbitration_id for frame in frames]
        return found


@pytest.fixture
def rig() -> Iterator[Rig]:
    made = Rig()
    made.receive(0.0)
    yield made
    for bus in made.made.values():
        os.close(bus.reader)
        os.close(bus.writer)


def test_the_frames_of_each_bus_come_by_themselves_and_in_their_order(rig: Rig) -> None:
    for identifier in (1, 2):
        rig.made["c"].put(identifier)
    rig.made["a"].put(3)
    assert rig.receive() == [[3], [], [1, 2]]
    assert rig.receive(0.0) == [[], [], []]


def test_only_the_bus_that_has_frames_is_read(rig: Rig) -> None:
    before = {name: bus.looks for name, bus in rig.made.items()}
    rig.made["b"].put(7)
    assert rig.receive() == [[], [7], []]
    assert {name: bus.looks - before[name] for name, bus in rig.made.items()} == {"a": 0, "b": 2, "c": 0}


def test_a_frame_without_a_stamp_counts_as_having_come_after_its_bus_was_last_seen_empty(rig: Rig) -> None:
    begun_ns = MachineTime().monotonic_ns()
    rig.made["a"].put(1)
    rig.receive()  # the others were seen empty meanwhile
    rig.made["b"].put(2)
    ((number, (frame,)),) = rig.buses.receive(5.0)
    assert number == 1
    assert frame.received_ns >= begun_ns // 1000 * 1000


def test_a_bus_that_is_away_is_tried_again_and_delays_no_other(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig.made["a"].is_cut = True
    rig.made["a"].put(9)
    rig.made["b"].put(1)
    assert rig.receive() == [[], [1], []]
    assert [port.is_open for port in rig.ports] == [False, True, True]
    rig.made["b"].put(2)
    assert rig.receive() == [[], [2], []]
    rig.made["a"].is_cut = False
    monkeypatch.setattr(rig.ports[0], "_next_try_s", 0.0)
    rig.made["b"].put(3)
    assert rig.receive() == [[9], [3], []]


class Watch(MachineTime):
    """A clock of the test, which waits at once."""

    def __init__(self) -> None:
        self.now_ns = 10**9

    def instant(self) -> Instant:
        return Instant(self.now_ns, self.now_ns)

    def sleep(self, duration_s: float) -> None:
        self.now_ns += round(duration_s * 1e9)


def test_the_time_that_was_asked_for_is_no_gap_and_the_time_between_two_receives_is() -> None:
    watch = Watch()
    ports = [BusPort(BusAddress(interface="virtual", channel=name), ports=Ports(watch, absent)) for name in "ab"]
    buses = Buses(ports, watch)
    buses.receive(0.05)
    assert buses.gap_ns == 0
    watch.sleep(0.007)
    buses.receive(0.05)
    assert buses.gap_ns == 7_000_000


def absent(_address: BusAddress, _wanted: Iterable[tuple[int, bool]]) -> Any:
    raise OSError(19, "No such device")
