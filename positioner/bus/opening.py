"""How a bus is opened, what to try where it cannot be, and what its socket says of itself. Shell."""

from __future__ import annotations

import os
import socket
import struct
from functools import cache
from importlib import metadata
from typing import TYPE_CHECKING, Any

import can
from can.interfaces.socketcan import SocketcanBus

from positioner.errors import PASSING, BusError, BusUnusableError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.bus.address import BusAddress

_IPV6_MULTICAST_ALL = 29
_IP_MULTICAST_ALL = 49
_SO_MEMINFO = 55
_MEMINFO = struct.Struct("=9I")
_RECEIVE_BUFFER_BYTES = 1 << 20
_EXTRAS = {"slcan": "serial", "robotell": "serial", "vector": "cvector"}
"""Interfaces whose optional dependencies python-can lists under another name than theirs."""
_PAGE = "https://python-can.readthedocs.io/en/stable/interfaces.html"
_NO_DRIVER = (NotImplementedError, ImportError, NameError, AttributeError)
REFUSALS = (can.CanError, OSError, ValueError, TypeError, *_NO_DRIVER)
"""What python-can and its interfaces raise when a bus cannot be opened."""


def open_bus(address: BusAddress, wanted: Iterable[tuple[int, bool]]) -> can.BusABC:
    """Return the bus at `address`, which hears the identifiers `wanted` (with their extended flag), or all if none.

    python-can's own files (/etc/can.conf, ~/.canrc) and environment have no say; reading them at each try would also
    take memory that only a garbage collection gives back.

    Raises:
        can.CanError: it cannot be opened; the other `REFUSALS` mean the same.
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


def refusal(address: BusAddress, error: Exception) -> BusError:
    """Return what one of the `REFUSALS` means: a `BusUnusableError` where no later try can succeed.

    A device that is away may come; a driver that is missing, or an option that is wrong, needs somebody.
    """
    said = " ".join(str(error).split()) or type(error).__name__
    if any(os.strerror(number) in said for number in PASSING):  # also where an interface could not be imported for it
        return BusError(f"bus {address} cannot be opened: {said}; the system refuses")
    # ctypes, and python-can's pcan, say of a missing library what is an OSError without a number
    if isinstance(error, _NO_DRIVER) or (type(error) is OSError and error.errno is None):
        return BusUnusableError(f"bus {address} cannot be used on this machine: {said}; {_driver(address)}")
    if isinstance(error, ValueError | TypeError):
        said = said.partition("__init__() ")[2] or said
        return BusUnusableError(f"bus {address} cannot be used: {said}; see [bus.options] and {_PAGE}")
    return BusError(f"bus {address} cannot be opened: {said}; {mend(address)}")


def _driver(address: BusAddress) -> str:
    """Return how the interface's driver gets onto this machine."""
    extra = _EXTRAS.get(address.interface, address.interface.replace("_", "-"))
    if extra in _extras():
        return f"try: python -m pip install 'python-can[{extra}]'  # and the driver of its maker"
    return f"install its driver, see {_PAGE}"


@cache
def _extras() -> frozenset[str]:
    """Return the names of python-can's sets of optional dependencies."""
    return frozenset(metadata.metadata("python-can").get_all("Provides-Extra") or ())


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


def descriptor_of(bus: can.BusABC) -> int | None:
    """Return the descriptor that says when a frame has come, None where the interface has none."""
    try:
        return bus.fileno()
    except (NotImplementedError, AttributeError):
        return None


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
