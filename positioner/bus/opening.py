"""Opening a bus: errors with advice, filters, and the counters of its socket. Shell."""

from __future__ import annotations

import os
import socket
import struct
from functools import cache
from importlib import metadata
from typing import TYPE_CHECKING, Any

import can
from can.interfaces.socketcan import SocketcanBus

from positioner.errors import TEMPORARY_ERRNOS, BusError, BusUnusableError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.bus.address import BusAddress

_IPV6_MULTICAST_ALL = 29
_IP_MULTICAST_ALL = 49
_SO_MEMINFO = 55
_MEMINFO = struct.Struct("=9I")
_RECEIVE_BUFFER_BYTES = 1 << 20
_EXTRAS = {"slcan": "serial", "robotell": "serial", "vector": "cvector"}
"""Interfaces whose optional dependencies python-can lists under another name."""
_PAGE = "https://python-can.readthedocs.io/en/stable/interfaces.html"
_NO_DRIVER = (NotImplementedError, ImportError, NameError, AttributeError)
OPENING_ERRORS = (can.CanError, OSError, ValueError, TypeError, *_NO_DRIVER)
"""Errors that python-can and its interfaces raise when a bus cannot be opened."""


def open_bus(address: BusAddress, wanted: Iterable[tuple[int, bool]]) -> can.BusABC:
    """Return the bus at `address`, which receives the identifiers `wanted` (with their extended flag), or all if none.

    python-can's own files (/etc/can.conf, ~/.canrc) and environment variables are ignored; to read them at each try
    would also take memory that only a garbage collection gives back.

    Raises:
        can.CanError: it cannot be opened; the other `OPENING_ERRORS` mean the same.
    """
    options: dict[str, Any] = dict(address.options)
    if address.interface == "socketcan":
        # the kernel filters; python-can's own filter would end a batch at the first frame that is not wanted
        filters: can.typechecking.CanFilters = [
            {"can_id": identifier, "can_mask": 0x1FFFFFFF if extended else 0x7FF, "extended": extended}
            for identifier, extended in wanted
        ]
        options["can_filters"] = filters or None
    if address.is_embedded:
        options |= {"port": address.port, "hop_limit": 0, "fd": False}
    bus = can.Bus(interface=address.interface, channel=address.numbered_channel, ignore_config=True, **options)
    if address.is_embedded:
        try:
            _confine(bus, address.channel)
        except OSError:
            bus.shutdown()
            raise
    return bus


def opening_error(address: BusAddress, error: Exception) -> BusError:
    """Return the error to raise for one of the `OPENING_ERRORS`: a `BusUnusableError` where no later try can succeed.

    A device that is away may come; a missing driver or a wrong option needs a person.
    """
    text = " ".join(str(error).split()) or type(error).__name__
    # such an error may also have kept an interface from being imported
    if any(os.strerror(number) in text for number in TEMPORARY_ERRNOS):
        return BusError(f"bus {address} cannot be opened: {text}; the system refuses")
    # where a library is missing, ctypes and python-can's pcan raise an OSError without a number
    if isinstance(error, _NO_DRIVER) or (type(error) is OSError and error.errno is None):
        return BusUnusableError(f"bus {address} cannot be used on this machine: {text}; {_driver(address)}")
    if isinstance(error, ValueError | TypeError):
        text = text.partition("__init__() ")[2] or text
        return BusUnusableError(f"bus {address} cannot be used: {text}; see [bus.options] and {_PAGE}")
    return BusError(f"bus {address} cannot be opened: {text}; {advice(address)}")


def _driver(address: BusAddress) -> str:
    """Return how to install the driver of the interface."""
    extra = _EXTRAS.get(address.interface, address.interface.replace("_", "-"))
    if extra in _extras():
        return f"try: python -m pip install 'python-can[{extra}]'  # and the manufacturer's driver"
    return f"install its driver, see {_PAGE}"


@cache
def _extras() -> frozenset[str]:
    """Return the names of python-can's sets of optional dependencies."""
    return frozenset(metadata.metadata("python-can").get_all("Provides-Extra") or ())


def _confine(bus: can.BusABC, group: str) -> None:
    """Let an embedded bus receive its own group only, and give it room for bursts.

    Its scope (IPv6: interface-local) and its hop limit of 0 keep its frames on this machine.
    """
    with socket.socket(fileno=os.dup(bus.fileno())) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
        if ":" in group:
            sock.setsockopt(socket.IPPROTO_IPV6, _IPV6_MULTICAST_ALL, 0)
        else:
            sock.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)


def descriptor_of(bus: can.BusABC) -> int | None:
    """Return the descriptor that is readable once a frame has come, None where the interface has none."""
    try:
        return bus.fileno()
    except (NotImplementedError, AttributeError):
        return None


def dropped_frames(bus: can.BusABC | None) -> int:
    """Return how many frames the kernel dropped because this socket's queue was full: the count of SO_RXQ_OVFL.

    It is read with SO_MEMINFO, whose ninth word it is: SO_RXQ_OVFL would report it only with the next frame.
    """
    if not isinstance(bus, SocketcanBus):
        return 0
    (*_, dropped) = _MEMINFO.unpack(bus.socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size))
    return int(dropped)


def advice(address: BusAddress) -> str:
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
