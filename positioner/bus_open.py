"""How a bus is opened, what to try where it cannot be, and what its socket says of itself. Shell."""

from __future__ import annotations

import os
import socket
import struct
from typing import TYPE_CHECKING

import can
from can.interfaces.socketcan import SocketcanBus

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.bus_address import BusAddress

_IPV6_MULTICAST_ALL = 29
_IP_MULTICAST_ALL = 49
_SO_MEMINFO = 55
_MEMINFO = struct.Struct("=9I")
_RECEIVE_BUFFER_BYTES = 1 << 20


def open_bus(address: BusAddress, wanted: Iterable[tuple[int, bool]]) -> can.BusABC:
    """Return the bus at `address`, which hears the identifiers `wanted` (with their extended flag), or all if none.

    Raises:
        can.CanError: it cannot be opened; OSError, ValueError and ImportError mean the same.
    """
    if address.interface == "socketcan":
        # the kernel filters; python-can's own filter would end a batch at the first frame that is not wanted
        filters: can.typechecking.CanFilters = [
            {"can_id": identifier, "can_mask": 0x1FFFFFFF if extended else 0x7FF, "extended": extended}
            for identifier, extended in wanted
        ]
        return can.Bus(interface=address.interface, channel=address.channel, can_filters=filters or None)
    if not address.is_embedded:
        return can.Bus(interface=address.interface, channel=address.channel)
    bus = can.Bus(interface="udp_multicast", channel=address.channel, port=address.port, hop_limit=0, fd=False)
    _confine(bus, address.channel)
    return bus


def _confine(bus: can.BusABC, group: str) -> None:
    """Make an embedded bus deaf to other groups of this machine, and give it room for bursts.

    Its scope (IPv6: interface-local) and its hop limit of 0 keep what it sends on this machine.
    """
    with socket.socket(fileno=os.dup(bus.fileno())) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
        if ":" in group:
            sock.setsockopt(socket.IPPROTO_IPV6, _IPV6_MULTICAST_ALL, 0)
        else:
            sock.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)


def dropped_frames(bus: can.BusABC | None) -> int:
    """Return how many frames the kernel dropped because this socket's queue was full: the count of SO_RXQ_OVFL.

    It is asked for with SO_MEMINFO, whose ninth word it is: python-can allows no second ancillary message.
    """
    if not isinstance(bus, SocketcanBus):
        return 0
    (*_, dropped) = _MEMINFO.unpack(bus.socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size))
    return int(dropped)


def mend(address: BusAddress) -> str:
    """Return what to try where the bus at `address` does not work."""
    if address.interface == "socketcan":
        name = address.channel
        kind = (
            f"sudo ip link add dev {name} type vcan && sudo ip link set {name} up"
            if name.startswith("vcan")
            else f"sudo ip link set {name} up type can bitrate 1000000 restart-ms 100"
        )
        return f"try: {kind}"
    return "check the [bus] table of the configuration"
