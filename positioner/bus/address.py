"""Where a bus is: an interface of python-can, its channel and options, and how to find one on this machine. Shell."""

from __future__ import annotations

import contextlib
import difflib
import ipaddress
import re
import socket
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

from annotated_types import Interval
from can.interfaces import BACKENDS

from positioner.errors import BusUnusableError
from positioner.inputs.table import SettingsTable

if TYPE_CHECKING:
    from collections.abc import Iterator

EMBEDDED = "embedded"
EMBEDDED_PORT = 43513
_NAMED = 1
"""Family of the embedded buses that a user names; those of a bench have family 0."""
Option: TypeAlias = bool | int | float | str
_LONGEST_NAME = 15
"""Characters of a network interface's name, IFNAMSIZ - 1 of linux/if.h."""
_WORDS: dict[str, Option] = {"true": True, "false": False}
_NAMED_CHANNELS = frozenset({"socketcan", "socketcand", "udp_multicast", "virtual"})
"""Interfaces whose channels are names even when they look like numbers."""
_RESERVED = frozenset({"interface", "bustype", "channel", "can_filters", "ignore_config", "config_context", "context"})
"""Arguments of python-can that the positioner itself gives, or never uses."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BusAddress(SettingsTable):
    """The `[bus]` table of a configuration: an interface of python-can, its channel, and a port where it has one.

    interface: an interface of python-can whose driver is installed; "embedded" is a bus inside this machine, for
        trials.
    channel: the bus, as its interface names it: "can0", "0", "PCAN_USBBUS1", "/dev/ttyUSB0@115200"; any name where
        embedded.
    port: UDP port of the interface "udp_multicast"; other interfaces have none.
    options: what the interface takes beside its channel, such as bitrate; the `[bus.options]` table.
    """

    interface: str = "socketcan"
    channel: str = "can0"
    port: Annotated[int, Interval(ge=1, le=65535)] = EMBEDDED_PORT
    options: dict[str, Option] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        """Replace the name of an embedded bus by its address."""
        if self.interface == EMBEDDED:
            address = embedded_address(zlib.crc32(self.channel.encode()), _NAMED)
            for name in ("interface", "channel", "port"):
                object.__setattr__(self, name, getattr(address, name))

    def __str__(self) -> str:
        """The form that `parse_address` reads."""
        port = f"@{self.port}" if self.is_embedded else ""
        options = "".join(f",{key}={_written(value)}" for key, value in self.options.items())
        return f"{self.interface}:{self.channel}{port}{options}"

    @property
    def place(self) -> tuple[str, str, int]:
        """What distinguishes this bus from every other one: its options do not."""
        return self.interface, self.channel, self.port if self.is_embedded else 0

    @property
    def numbered_channel(self) -> str | int:
        """The channel as python-can's interface takes it: most adapters number their channels."""
        is_number = self.interface not in _NAMED_CHANNELS and self.channel.isdecimal()
        return int(self.channel) if is_number else self.channel

    @property
    def is_embedded(self) -> bool:
        """Whether this is python-can's UDP multicast, the bus for machines without CAN."""
        return self.interface == "udp_multicast"


def parse_address(text: str) -> BusAddress:
    """Return the address in `INTERFACE:CHANNEL[@PORT][,OPTION=VALUE...]`, for example `socketcan:vcan0`.

    Only the embedded bus has a port; with other interfaces an @ and the text after it belong to the channel, as in
    `slcan:/dev/ttyUSB0@115200,bitrate=500000`.

    Raises:
        BusUnusableError: the text has another form, or contains a setting that no bus has.
    """
    found = re.fullmatch(r"([a-z_]\w*):([^=]+?)((?:,[A-Za-z_]\w*=[^,]*)*)", text)
    if not found:
        form = "INTERFACE:CHANNEL[@PORT][,OPTION=VALUE...]"
        raise BusUnusableError(f"bus '{text}' is not {form}, for example socketcan:vcan0")
    interface, channel = found[1], found[2]
    pairs = (pair.split("=", maxsplit=1) for pair in found[3].split(",")[1:])
    port = EMBEDDED_PORT
    if interface == "udp_multicast" and "@" in channel:
        channel, _, digits = channel.partition("@")
        port = int(digits) if re.fullmatch(r"\d{1,5}", digits) else 0
        if not 1 <= port <= 65535:  # noqa: PLR2004 - the ports there are
            raise BusUnusableError(f"bus '{text}': the PORT in INTERFACE:CHANNEL@PORT must be from 1 to 65535")
    address = BusAddress(
        interface=interface, channel=channel, port=port, options={key: _read(value) for key, value in pairs}
    )
    if problem := next(problems_of(address), None):
        raise BusUnusableError(f"bus '{text}': {problem[0]} {problem[1]}")
    return address


def problems_of(address: BusAddress) -> Iterator[tuple[str, str]]:
    """Yield each setting with which no bus can be opened: its key in `[bus]` with its value, and the mistake."""
    interface, channel = f"interface = '{address.interface}'", f"channel = '{address.channel}'"
    if address.interface not in BACKENDS:
        known = (EMBEDDED, *BACKENDS)
        close = difflib.get_close_matches(address.interface, known, n=1, cutoff=0.5)
        yield interface, f"is unknown; did you mean '{close[0]}'?" if close else f"is none of {', '.join(known)}"
    if address.interface == "socketcan" and not 1 <= len(address.channel) <= _LONGEST_NAME:
        yield channel, f"must have 1 to {_LONGEST_NAME} characters, as every network interface's name"
    if address.is_embedded and not _is_group(address.channel):
        yield channel, "is no multicast group, such as ff11::1 or 239.255.0.1"
    for key, value in address.options.items():
        if reason := _refusal(address.interface, key):
            yield f"options.{key} = {_written(value)}", reason


def _refusal(interface: str, key: str) -> str:
    """Return why an interface may not have this option; empty where it may."""
    if key in _RESERVED:
        return "is no option: it stands beside [bus.options], or is the positioner's own"
    if key == "receive_own_messages":
        return "would make the positioner take its own commands for another controller's; leave it out"
    if interface == "udp_multicast":
        return "is no option of the embedded bus, which has only its port"
    if interface == "socketcan" and key not in {"local_loopback", "ignore_rx_error_frames"}:
        return "is set on the interface itself: sudo ip link set can0 up type can bitrate 500000, for example"
    return ""


def _is_group(channel: str) -> bool:
    try:
        return ipaddress.ip_address(channel).is_multicast
    except ValueError:
        return False


def _read(text: str) -> Option:
    """Return the value of an option: a number or a truth value where it reads as one."""
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text)
    return _WORDS.get(text, text)


def _written(value: Option) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def find_vcan() -> BusAddress | None:
    """Return the first virtual CAN interface of this machine that is up, or None."""
    for device in sorted(Path("/sys/class/net").glob("vcan*")):
        with contextlib.suppress(OSError, ValueError):
            if int((device / "flags").read_text(encoding="ascii"), 16) & 1:
                return BusAddress(interface="socketcan", channel=device.name)
    return None


def embedded_address(token: int, family: int = 0) -> BusAddress:
    """Return an embedded bus of its own for `token`: an interface-local group, which never leaves this machine.

    Where the machine has no IPv6 it is an IPv4 group, which a time to live of 0 keeps on the machine.
    """
    port = EMBEDDED_PORT + token % 2000
    if _has_interface_local_groups():
        group = f"ff11::7661:6c76:{family:x}:{token & 0xFFFF:x}"
    else:
        group = f"239.{255 - family}.{token >> 8 & 0xFF}.{token & 0xFF}"
    return BusAddress(interface="udp_multicast", channel=group, port=port)


def _has_interface_local_groups() -> bool:
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as sock:
            sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_HOPS, 0)
            sock.sendto(b"", ("ff11::7661:6c76:0:0", EMBEDDED_PORT))
    except OSError:
        return False
    return True
