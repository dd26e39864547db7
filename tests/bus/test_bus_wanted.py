"""A bus delivers every frame to a port, its own ones as well: the port returns the wanted ones, and waits for them."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest
from daemon_helpers import own_address

from positioner.bus.port import BusPort
from positioner.wire.messages import CanFrame

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.bus.address import BusAddress

WAIT_S = 0.1
WANTED = ((0x100, False), (0x1ABCDEF0, True))


@pytest.fixture
def address() -> BusAddress:
    return own_address()


@pytest.fixture
def port(address: BusAddress) -> Iterator[BusPort]:
    made = BusPort(address, WANTED)
    made.open()
    yield made
    made.close()


@pytest.fixture
def sender(address: BusAddress) -> Iterator[BusPort]:
    made = BusPort(address)
    made.open()
    yield made
    made.close()


def test_only_the_wanted_identifiers_are_received_each_with_its_length(port: BusPort, sender: BusPort) -> None:
    frames = (
        CanFrame(0x101, b"other"),
        CanFrame(0x100, b"long", is_extended=True),
        CanFrame(0x100, b"a"),
        CanFrame(0x0BCDEF0, b"short", is_extended=True),
        CanFrame(0x1ABCDEF0, b"b", is_extended=True),
        CanFrame(0x7FF, b"other"),
    )
    for frame in frames:
        assert sender.send(frame)
    assert [frame.data for frame in port.receive(WAIT_S)] == [b"a", b"b"]


def test_what_is_not_wanted_does_not_cut_a_batch_in_two(port: BusPort, sender: BusPort) -> None:
    for number in range(50):
        sender.send(CanFrame(0x170, b"truth"))
        sender.send(CanFrame(0x100, bytes([number])))
    assert [frame.data[0] for frame in port.receive(WAIT_S)] == list(range(50))


@pytest.mark.parametrize("identifier", [0x100, 0x170])
def test_neither_its_own_frames_nor_unwanted_ones_end_the_waiting(
    identifier: int, port: BusPort, sender: BusPort
) -> None:
    assert (port if identifier == 0x100 else sender).send(CanFrame(identifier, b"nothing"))
    start_s = time.monotonic()
    assert port.receive(WAIT_S) == ()
    assert 0.9 * WAIT_S <= time.monotonic() - start_s < WAIT_S + 30.0


def test_a_wanted_frame_behind_its_own_one_ends_the_waiting(port: BusPort, sender: BusPort) -> None:
    port.send(CanFrame(0x100, b"own"))
    sender.send(CanFrame(0x100, b"other"))
    start_s = time.monotonic()
    assert [frame.data for frame in port.receive(30.0)] == [b"other"]
    assert time.monotonic() - start_s < 10.0
