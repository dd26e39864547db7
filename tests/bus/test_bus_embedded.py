"""The CAN port, one class of tests for every bus: a subclass names the bus. Whatever is left open fails the test."""

from __future__ import annotations

import contextlib
import gc
import os
import socket
import time
from pathlib import Path
from typing import TYPE_CHECKING

import can
import pytest
from daemon_helpers import own_address

from positioner.bus import address as address_module
from positioner.bus import port as bus_module
from positioner.bus.address import EMBEDDED_PORT, BusAddress, embedded_address, find_vcan, parse_address
from positioner.bus.events import BusBack, BusDown, BusNotOpened, NoFrame, SendFailed
from positioner.bus.message_link import MessageLink
from positioner.bus.opening import open_bus
from positioner.bus.port import BusPort
from positioner.errors import BusError, BusUnusableError, ExitCode
from positioner.wire.messages import CanFrame

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.bus.events import BusEvent

TIMEOUT_S = 20.0
QUIET_S = 0.05


def open_descriptors() -> set[str]:
    """Return the files that this process has open, without the directory that is being listed."""
    found = set()
    for descriptor in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):
            found.add(f"{descriptor.name} {descriptor.readlink()}")
    return found


class BusContract:
    """What every bus does. A subclass returns the address of a bus that nobody else uses."""

    def address(self) -> BusAddress:
        raise NotImplementedError

    @pytest.fixture(autouse=True)
    def nothing_is_left_open(self) -> Iterator[None]:
        before = open_descriptors()
        self.ports: list[BusPort] = []
        yield
        for port in self.ports:
            port.close()
        gc.collect()
        assert open_descriptors() <= before

    @pytest.fixture
    def pair(self) -> tuple[BusPort, BusPort]:
        address = self.address()
        return self.port(address), self.port(address)

    def port(self, address: BusAddress, identifiers: tuple[tuple[int, bool], ...] = ()) -> BusPort:
        port = BusPort(address, identifiers)
        self.ports.append(port)
        port.open()
        return port

    def wait_for(self, port: BusPort, count: int) -> list[CanFrame]:
        """Return `count` frames, or those that came within `TIMEOUT_S`."""
        frames: list[CanFrame] = []
        deadline_s = time.monotonic() + TIMEOUT_S
        while len(frames) < count and time.monotonic() < deadline_s:
            frames += port.receive(0.1)
        return frames

    def test_a_frame_arrives_as_it_was_sent(self, pair: tuple[BusPort, BusPort]) -> None:
        one, other = pair
        for frame in (CanFrame(0x123, bytes(range(8))), CanFrame(0x7FF, b""), CanFrame(0x1ABCDEF0, b"\xff", True)):
            before_ns = time.monotonic_ns()
            assert one.send(frame)
            (received,) = self.wait_for(other, 1)
            assert (received.arbitration_id, received.data, received.is_extended) == (
                frame.arbitration_id,
                frame.data,
                frame.is_extended,
            )
            assert not received.is_error
            assert not received.is_remote
            assert before_ns <= received.received_ns <= time.monotonic_ns()

    def test_a_burst_arrives_complete_and_in_order(self, pair: tuple[BusPort, BusPort]) -> None:
        one, other = pair
        sent = [CanFrame(0x100, number.to_bytes(2, "big")) for number in range(200)]
        assert all(one.send(frame) for frame in sent)
        received = self.wait_for(other, len(sent))
        assert [frame.data for frame in received] == [frame.data for frame in sent]

    def test_a_batch_holds_all_that_waits(self, pair: tuple[BusPort, BusPort]) -> None:
        one, other = pair
        for number in range(5):
            one.send(CanFrame(0x100, bytes([number])))
        self.settle(other, one)
        assert [frame.data[0] for frame in other.receive(QUIET_S)] == list(range(5))

    def settle(self, receiver: BusPort, sender: BusPort) -> None:
        """Wait until what was sent lies in the receiver's queue; buses inside the machine need no time."""
        del receiver, sender

    def test_a_node_does_not_receive_its_own_frames(self, pair: tuple[BusPort, BusPort]) -> None:
        one, other = pair
        for number in range(20):
            one.send(CanFrame(0x100, bytes([number])))
            other.send(CanFrame(0x100, bytes([100 + number])))
        assert [frame.data[0] for frame in self.wait_for(one, 20)] == list(range(100, 120))
        assert [frame.data[0] for frame in self.wait_for(other, 20)] == list(range(20))
        assert one.receive(QUIET_S) == ()

    def test_an_identical_frame_of_somebody_else_is_received(self, pair: tuple[BusPort, BusPort]) -> None:
        one, other = pair
        same = CanFrame(0x100, b"same")
        one.send(same)
        one.receive(QUIET_S)
        other.send(same)
        assert [frame.data for frame in self.wait_for(one, 1)] == [b"same"]

    def test_silence_ends_with_the_timeout(self, pair: tuple[BusPort, BusPort]) -> None:
        one, _ = pair
        start_s = time.monotonic()
        assert one.receive(QUIET_S) == ()
        assert QUIET_S * 0.9 <= time.monotonic() - start_s < QUIET_S + TIMEOUT_S

    def test_a_closed_port_opens_itself_again(self, pair: tuple[BusPort, BusPort]) -> None:
        one, other = pair
        states = [other.is_open]
        other.close()
        states += [other.is_open, other.send(CanFrame(0x100, b""))]
        other.receive(0.0)
        assert [*states, other.is_open] == [True, False, False, True]
        one.send(CanFrame(0x100, b"back"))
        assert [frame.data for frame in self.wait_for(other, 1)] == [b"back"]

    def test_closing_twice_is_no_mistake(self, pair: tuple[BusPort, BusPort]) -> None:
        for port in (*pair, *pair):
            port.close()
            assert not port.is_open

    def test_buses_of_different_addresses_share_no_frames(self) -> None:
        one, other = self.port(self.address()), self.port(self.address())
        one.send(CanFrame(0x100, b"private"))
        assert other.receive(QUIET_S) == ()


class TestEmbeddedBus(BusContract):
    """python-can's UDP multicast: the bus for machines without one."""

    def address(self) -> BusAddress:
        return own_address()

    def test_what_is_no_can_frame_is_dropped_and_the_bus_goes_on(self) -> None:
        address = self.address()
        port, sender = self.port(address), self.port(address)
        events: list[BusEvent] = []
        port._report = events.append
        family = socket.AF_INET6 if ":" in address.channel else socket.AF_INET
        with socket.socket(family, socket.SOCK_DGRAM) as stranger:
            option = (
                (socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_HOPS)
                if ":" in address.channel
                else (socket.IPPROTO_IP, socket.IP_MULTICAST_TTL)
            )
            stranger.setsockopt(*option, 0)
            stranger.sendto(b"\xc1no frame", (address.channel, address.port))
        sender.send(CanFrame(0x100, b"fine"))
        frames = self.wait_for(port, 2)
        assert frames[-1].data == b"fine"
        assert all(frame.is_error for frame in frames[:-1])
        assert [type(event) for event in events] == [NoFrame]

    def test_nothing_leaves_this_machine(self) -> None:
        address = self.address()
        port = self.port(address)
        assert port._bus is not None
        with socket.socket(fileno=os.dup(port._bus.fileno())) as sock:
            if ":" in address.channel:
                assert address.channel.startswith("ff11:")  # scope 1: the interface itself
                assert sock.getsockopt(socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_HOPS) == 0
            else:
                assert sock.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0


class TestVirtualBus(BusContract):
    """python-can's bus inside one process."""

    numbers = iter(range(1000))

    def address(self) -> BusAddress:
        return BusAddress(interface="virtual", channel=f"test-{os.getpid()}-{next(self.numbers)}")

    def test_only_the_wanted_identifiers_are_received(self) -> None:
        address = self.address()
        wanted, sender = self.port(address, ((0x100, False), (0x100, True))), self.port(address)
        for frame in (CanFrame(0x101, b""), CanFrame(0x100, b"a"), CanFrame(0x100, b"b", True), CanFrame(0x500, b"")):
            sender.send(frame)
        assert [frame.data for frame in self.wait_for(wanted, 2)] == [b"a", b"b"]
        assert wanted.receive(QUIET_S) == ()


class BrokenBus:
    """A bus that fails when the test demands it."""

    def __init__(self) -> None:
        self.down = False
        self.was_shut_down = False

    def recv(self, timeout_s: float) -> None:
        del timeout_s
        if self.down:
            raise can.CanOperationError("network is down")

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        del message, timeout
        if self.down:
            raise can.CanOperationError("no buffer space")

    def shutdown(self) -> None:
        self.was_shut_down = True


def test_a_bus_that_goes_down_is_a_state_and_is_reported_once(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[BrokenBus] = []
    now_s = [100.0]

    def open_bus(_address: BusAddress, _filters: object) -> BrokenBus:
        if opened and opened[-1].down and now_s[0] < 102.0:
            raise OSError(19, "no such device")
        opened.append(BrokenBus())
        return opened[-1]

    monkeypatch.setattr(bus_module, "open_bus", open_bus)
    monkeypatch.setattr(time, "monotonic", lambda: now_s[0])
    monkeypatch.setattr(time, "sleep", lambda _seconds: None)
    events: list[BusEvent] = []
    port = BusPort(BusAddress(channel="can7"), report=events.append)
    assert port.receive(0.0) == ()
    states = [port.is_open, port.send(CanFrame(0x100, b""))]
    opened[-1].down = True
    states.append(port.send(CanFrame(0x100, b"")))
    assert port.receive(0.0) == ()
    assert [*states, port.is_open] == [True, True, False, False]
    assert opened[-1].was_shut_down
    for now_s[0] in (100.1, 100.6, 101.2):
        assert port.receive(0.0) == ()
        assert not port.send(CanFrame(0x100, b""))
    now_s[0] = 102.0
    port.receive(0.0)
    assert port.is_open
    assert len(opened) == 2
    assert [type(event) for event in events] == [SendFailed, BusDown, BusNotOpened, BusBack]
    lines = [str(event) for event in events]
    assert all(line.startswith("bus socketcan:can7 ") for line in lines)
    assert ["did not take a frame" in lines[0], "is down" in lines[1], "cannot be opened" in lines[2]] == [True] * 3
    assert "sudo ip link set can7 up" in lines[1]
    assert lines[3] == "bus socketcan:can7 is there again"
    port.close()


def test_a_wall_clock_that_is_set_back_delays_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = open_bus(own_address(), ())
    start_s = time.monotonic()
    monkeypatch.setattr("can.bus.time", lambda: time.monotonic() - (5.0 if time.monotonic() > start_s + 0.05 else 0.0))
    assert MessageLink(bus).receive(0.1) is None
    assert time.monotonic() - start_s < 4.0
    bus.shutdown()


def test_a_bus_that_is_not_there_says_what_to_do() -> None:
    with pytest.raises(BusError, match="sudo ip link add dev vcan77 type vcan") as caught:
        BusPort(BusAddress(channel="vcan77")).open()
    assert caught.value.exit_code is ExitCode.UNAVAILABLE
    with pytest.raises(BusUnusableError, match="CAN interface 'no_such_interface' not supported"):
        BusPort(BusAddress(interface="no_such_interface")).open()


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("socketcan:vcan0", BusAddress(interface="socketcan", channel="vcan0")),
        ("udp_multicast:239.74.1.2", BusAddress(interface="udp_multicast", channel="239.74.1.2")),
        ("udp_multicast:ff11::1@4242", BusAddress(interface="udp_multicast", channel="ff11::1", port=4242)),
    ],
)
def test_an_address_is_read_and_written(text: str, address: BusAddress) -> None:
    assert parse_address(text) == address
    assert parse_address(str(address)) == address


@pytest.mark.parametrize("text", ["", "vcan0", "socketcan:", ":vcan0", "SOCKETCAN:vcan0", "udp_multicast:ff11::1@x"])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(BusError, match="INTERFACE:CHANNEL"):
        parse_address(text)


@pytest.mark.parametrize("port", [0, 65536, 99999])
def test_a_port_that_does_not_exist_is_refused(port: int) -> None:
    with pytest.raises(BusError, match="PORT"):
        parse_address(f"udp_multicast:ff11::1@{port}")


@pytest.mark.parametrize("local", [True, False])
def test_embedded_addresses_differ_and_stay_on_the_machine(local: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(address_module, "_has_interface_local_groups", lambda: local)
    addresses = [embedded_address(token) for token in range(0, 40_000, 97)]
    assert len({(address.channel, address.port) for address in addresses}) == len(addresses)
    assert all(address.channel.startswith("ff11::" if local else "239.255.") for address in addresses)
    assert all(EMBEDDED_PORT <= address.port <= 65535 for address in addresses)


def test_a_machine_without_ipv6_has_no_interface_local_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_socket(*_args: object) -> socket.socket:
        raise OSError("address family not supported")

    monkeypatch.setattr(socket, "socket", no_socket)
    assert not address_module._has_interface_local_groups()


def test_a_virtual_can_interface_is_found_when_it_is_up(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name, flags in (("vcan0", "0x80"), ("vcan1", "0xc1"), ("vcan2", "0xc1"), ("vcanx", "nonsense")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "flags").write_text(flags, encoding="ascii")
    monkeypatch.setattr(address_module, "Path", lambda _path: tmp_path)
    assert find_vcan() == BusAddress(interface="socketcan", channel="vcan1")
    for name in ("vcan1", "vcan2"):
        (tmp_path / name / "flags").write_text("0x80", encoding="ascii")
    assert find_vcan() is None
