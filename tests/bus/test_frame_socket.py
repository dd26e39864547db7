"""Frames read from a socket and written to it: the bytes are those of the kernel's header and of python-can."""

from __future__ import annotations

import os
import socket
import struct
from typing import TYPE_CHECKING

import can
import pytest
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.socketcan.socketcan import build_can_frame
from can.interfaces.udp_multicast.utils import pack_message, unpack_message
from hypothesis import given
from hypothesis import strategies as st

from positioner.bus import frame_socket
from positioner.bus.address import BusAddress
from positioner.bus.frame_socket import socket_of
from positioner.bus.message_link import MessageLink
from positioner.bus.raw_frame import NoFrameError
from positioner.wire.messages import CanFrame

if TYPE_CHECKING:
    from collections.abc import Iterator

FRAMES = st.one_of(
    st.builds(CanFrame, st.integers(0, 0x7FF), st.binary(max_size=8)),
    st.builds(CanFrame, st.integers(0, 0x1FFFFFFF), st.binary(max_size=8), st.just(True)),
)


def message_of(frame: CanFrame) -> can.Message:
    return can.Message(arbitration_id=frame.arbitration_id, data=frame.data, is_extended_id=frame.is_extended)


@given(FRAMES)
def test_a_can_frame_has_the_bytes_of_python_can_and_is_read_as_it_was_written(frame: CanFrame) -> None:
    data = frame_socket._to_can(frame)
    theirs = build_can_frame(message_of(frame))
    assert data == theirs[:7] + b"\0" + theirs[8:]  # len8_dlc: only for a length code beyond eight
    assert frame_socket._from_can(memoryview(data)) == (
        frame.arbitration_id, frame.data, frame.is_extended, False, False,
    )  # fmt: skip


@given(FRAMES)
def test_a_datagram_is_what_python_can_packs_and_unpacks(frame: CanFrame) -> None:
    expected = (frame.arbitration_id, frame.data, frame.is_extended, False, False)
    assert frame_socket._from_msgpack(memoryview(pack_message(message_of(frame)))) == expected
    read = unpack_message(frame_socket._to_msgpack(frame))
    assert (read.arbitration_id, bytes(read.data), read.is_extended_id, read.dlc) == (*expected[:3], len(frame.data))


def test_error_and_remote_frames_keep_their_flags() -> None:
    error = struct.pack("=IB3x8s", socket.CAN_ERR_FLAG | 0x4, 8, bytes([0, 1, 0, 0, 0, 0, 0, 0]))
    assert frame_socket._from_can(memoryview(error)) == (0x4, bytes([0, 1, 0, 0, 0, 0, 0, 0]), False, True, False)
    remote = struct.pack("=IB3x8s", socket.CAN_RTR_FLAG | 0x123, 0, b"")
    assert frame_socket._from_can(memoryview(remote)) == (0x123, b"", False, False, True)


@pytest.mark.parametrize("data", [b"", b"x", bytes(15), bytes(72)])
def test_what_has_not_the_length_of_a_classic_frame_is_none(data: bytes) -> None:
    with pytest.raises(NoFrameError, match="no classic CAN frame"):
        frame_socket._from_can(memoryview(data))


@pytest.mark.parametrize("data", [b"", b"\xc1no frame", b"\x01", b"\x80", b"\x81\xaearbitration_id\xa1x"])
def test_a_datagram_that_is_no_frame_is_none(data: bytes) -> None:
    with pytest.raises(NoFrameError):
        frame_socket._from_msgpack(memoryview(data))


class Wire(SocketcanBus):
    """A bus whose socket is one end of a pair, since this kernel may have no CAN."""

    def __init__(self, end: socket.socket) -> None:
        self.end = end

    def fileno(self) -> int:
        return self.end.fileno()

    def shutdown(self) -> None:
        self.end.close()

    def __del__(self) -> None:
        pass


@pytest.fixture
def wire() -> Iterator[tuple[Wire, socket.socket]]:
    one, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with one, other:
        yield Wire(one), other


def test_frames_pass_and_silence_is_none(wire: tuple[Wire, socket.socket]) -> None:
    bus, other = wire
    link = socket_of(bus, BusAddress())
    assert link is not None
    assert link.receive(0.0) is None
    assert link.receive(0.001) is None
    for number in range(3):
        other.send(frame_socket._to_can(CanFrame(0x100, bytes([number]))))
    received = [link.receive(1.0) for _ in range(3)]
    assert received == [(0x100, bytes([number]), False, False, False, 0.0) for number in range(3)]
    link.send(CanFrame(0x1ABCDEF0, b"abc", True))
    assert frame_socket._from_can(memoryview(other.recv(100))) == (0x1ABCDEF0, b"abc", True, False, False)
    link.close()
    assert os.fstat(bus.fileno())


def test_a_full_queue_is_an_error_after_a_short_wait_and_room_ends_it(wire: tuple[Wire, socket.socket]) -> None:
    bus, other = wire
    link = socket_of(bus, BusAddress())
    assert link is not None

    def fill() -> None:
        for _ in range(100_000):
            link.send(CanFrame(0x100, b"full"))

    with pytest.raises(OSError, match="temporarily unavailable"):
        fill()
    other.recv(100)
    link.send(CanFrame(0x100, b"room"))
    link.close()


def test_other_buses_keep_the_methods_of_python_can() -> None:
    with can.Bus(interface="virtual", channel=f"link-{os.getpid()}") as bus:
        assert socket_of(bus, BusAddress(interface="virtual", channel="x")) is None
        link = MessageLink(bus)
        assert link.receive(0.0) is None
        link.send(CanFrame(0x100, b"a"))
        link.close()
