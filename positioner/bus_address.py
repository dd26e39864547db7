"""Where a bus is: an interface of python-can and its channel, and how to find one on this machine. Shell."""

from __future__ import annotations

import contextlib
import re
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from annotated_types import Interval

from positioner.errors import BusError

EMBEDDED_PORT = 43513


@dataclass(frozen=True, slots=True, kw_only=True)
class BusAddress:
    """The `[bus]` table of a configuration: an interface of python-can, its channel, and a port where it has one."""

    __pydantic_config__: ClassVar = {"extra": "forbid"}

    interface: str = "socketcan"
    channel: str = "can0"
    port: Annotated[int, Interval(ge=1, le=65535)] = EMBEDDED_PORT

    def __str__(self) -> str:
        """The form that `parse_address` reads."""
        port = f"@{self.port}" if self.is_embedded else ""
        return f"{self.interface}:{self.channel}{port}"

    @property
    def is_embedded(self) -> bool:
        """Whether this is python-can's UDP multicast, the bus for machines without one."""
        return self.interface == "udp_multicast"


def parse_address(text: str) -> BusAddress:
    """Return the address in `INTERFACE:CHANNEL[@PORT]`, for example `socketcan:vcan0`.

    Raises:
        BusError: the text has another form.
    """
    found = re.fullmatch(r"([a-z_]+):([^@]+)(?:@(\d{1,5}))?", text)
    port = int(found[3] or EMBEDDED_PORT) if found else 0
    if not found or not 1 <= port <= 65535:  # noqa: PLR2004 - the ports there are
        raise BusError(f"bus '{text}' is not INTERFACE:CHANNEL[@PORT], for example socketcan:vcan0")
    return BusAddress(interface=found[1], channel=found[2], port=port)


def find_vcan() -> BusAddress | None:
    """Return the first virtual CAN interface of this machine that is up, or None."""
    for device in sorted(Path("/sys/class/net").glob("vcan*")):
        with contextlib.suppress(OSError, ValueError):
            if int((device / "flags").read_text(encoding="ascii"), 16) & 1:
                return BusAddress(interface="socketcan", channel=device.name)
    return None


def embedded_address(token: int) -> BusAddress:
    """Return an embedded bus of its own for `token`: an interface-local group, which never leaves this machine.

    Where the machine has no IPv6 it is an IPv4 group, which a time to live of 0 keeps on the machine.
    """
    port = EMBEDDED_PORT + token % 2000
    if _has_interface_local_groups():
        return BusAddress(interface="udp_multicast", channel=f"ff11::7661:6c76:0:{token & 0xFFFF:x}", port=port)
    return BusAddress(interface="udp_multicast", channel=f"239.255.{token >> 8 & 0xFF}.{token & 0xFF}", port=port)


def _has_interface_local_groups() -> bool:
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as sock:
            sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_HOPS, 0)
            sock.sendto(b"", ("ff11::7661:6c76:0:0", EMBEDDED_PORT))
    except OSError:
        return False
    return True
