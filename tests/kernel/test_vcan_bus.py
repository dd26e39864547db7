"""The CAN port on a virtual CAN interface: the contract of every bus, and what only SocketCAN has."""

from __future__ import annotations

import socket
import struct
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from links import command, until, vcan
from test_bus_embedded import BusContract

from positioner.bus.events import Overrun
from positioner.bus.port import BusPort
from positioner.wire.messages import CanFrame

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.bus.address import BusAddress
    from positioner.bus.events import BusEvent

pytestmark = [pytest.mark.kernel("vcan"), pytest.mark.short_form]
QUEUE_FRAMES = 278
"""Classic frames in a raw socket's default receive buffer."""


class TestVcan(BusContract):
    """Every test of a bus, on vcan."""

    @pytest.fixture(autouse=True)
    def links(self) -> Iterator[None]:
        with ExitStack() as self.stack:
            yield

    def address(self) -> BusAddress:
        return self.stack.enter_context(vcan())


@pytest.fixture
def bus() -> Iterator[BusAddress]:
    with vcan() as address:
        yield address


@pytest.fixture
def ports(bus: BusAddress) -> Iterator[tuple[BusPort, BusPort]]:
    pair = (BusPort(bus, [(0x100, False), (0x1ABCDEF0, True)]), BusPort(bus))
    for port in pair:
        port.open()
    yield pair
    for port in pair:
        port.close()


def filters(device: str) -> set[str]:
    """Return the filters that the kernel holds for a device: identifier and mask as it prints them."""
    found = set()
    for table in ("rcvlist_sff", "rcvlist_eff", "rcvlist_fil", "rcvlist_all"):
        for line in Path(f"/proc/net/can/{table}").read_text(encoding="ascii").splitlines():
            words = line.split()
            if words[:1] == [device] and "entry" not in line:
                found.add(f"{words[1]} {words[2]}" if table != "rcvlist_all" else "all")
    return found


def test_the_kernel_filters_what_the_dbc_does_not_name(ports: tuple[BusPort, BusPort], bus: BusAddress) -> None:
    one, other = ports
    held = filters(bus.channel)
    assert "100 800007ff" in held
    assert any(line.startswith("9abcdef0 ") for line in held)
    for frame in (CanFrame(0x101, b""), CanFrame(0x100, b"a"), CanFrame(0x1ABCDEF0, b"b", True), CanFrame(0x7FF, b"")):
        assert other.send(frame)
    assert [frame.data for frame in one.receive(1.0)] == [b"a", b"b"]


def test_a_burst_that_the_receive_queue_cannot_hold_is_counted(ports: tuple[BusPort, BusPort]) -> None:
    one, other = ports
    events: list[BusEvent] = []
    one._report = events.append
    for number in range(QUEUE_FRAMES * 3):
        assert other.send(CanFrame(0x100, number.to_bytes(2, "big")))
    received = [frame for _ in range(3) for frame in one.receive(0.1)]
    (overrun,) = events
    assert isinstance(overrun, Overrun)
    assert len(received) + overrun.count == QUEUE_FRAMES * 3
    assert [int.from_bytes(frame.data, "big") for frame in received] == list(
        range(len(received))
    )  # the newest are dropped
    other.send(CanFrame(0x100, b"on"))
    assert [frame.data for frame in one.receive(1.0)] == [b"on"]


def test_an_error_frame_of_the_controller_is_seen_as_one(ports: tuple[BusPort, BusPort], bus: BusAddress) -> None:
    one, _ = ports
    with socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as controller:
        controller.bind((bus.channel,))
        # error class "controller problems", data[1] = receive queue overflow (linux/can/error.h)
        controller.send(struct.pack("=IB3x8s", socket.CAN_ERR_FLAG | 0x4, 8, bytes([0, 1, 0, 0, 0, 0, 0, 0])))
    (received,) = one.receive(1.0)
    assert received.is_error
    assert (received.arbitration_id, received.data[1]) == (0x4, 1)


def test_a_link_that_goes_down_and_comes_up_is_a_state_of_the_port(ports: tuple[BusPort, BusPort]) -> None:
    one, other = ports
    name = one.address.channel
    command("ip", "link", "set", name, "down")
    until(lambda: not (one.receive(0.05) or one.is_open))
    assert not one.send(CanFrame(0x100, b"lost"))
    command("ip", "link", "set", name, "up")

    def is_received() -> bool:
        other.receive(0.0)
        other.send(CanFrame(0x100, b"back"))
        return any(frame.data == b"back" for frame in one.receive(0.05))

    until(is_received)
