"""The network interfaces in the answer of `ip -details -statistics -json link show`, as typed values. Pure."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """One network interface.

    kind: the kernel's name of the driver's family: `can` for a controller, `vcan`, `vxcan`; empty for others.
    state: the state of the controller, such as ERROR-ACTIVE; empty where there is none.
    bitrate: in bit/s; None where there is no bit timing: virtual buses, and controllers never configured.
    restart_ms: ms from bus-off to the automatic restart, 0 for none, None where there is no controller.
    error_counters: the controller's transmit and receive error counters, None where it has none.
    totals: events since the driver was loaded, by their names in the kernel, such as bus_off.
    """

    name: str
    is_can: bool
    kind: str
    is_up: bool
    queue_frames: int
    state: str = ""
    bitrate: int | None = None
    sample_point: float | None = None
    restart_ms: int | None = None
    error_counters: tuple[int, int] | None = None
    control_modes: frozenset[str] = frozenset()
    totals: Mapping[str, int]
    receive_overruns: int = 0

    @property
    def is_controller(self) -> bool:
        """Whether the interface has a real controller, with a bitrate and error counters."""
        return self.kind == "can"


class UnreadableAnswerError(ValueError):
    """The answer of `ip` is not JSON, or not the documented JSON."""


def parse_links(text: str) -> tuple[Link, ...]:
    """Return the interfaces in the answer of `ip`, a JSON array, in their order.

    Raises:
        UnreadableAnswerError: the answer is no such array.
    """
    try:
        # `ip -json` leaves an empty object in place of an interface that its filter hides
        return tuple(_link(entry) for entry in json.loads(text or "[]") if entry)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UnreadableAnswerError(f"{type(error).__name__}: {error}") from error


def _link(entry: dict[str, Any]) -> Link:
    information = entry.get("linkinfo", {})
    data = information.get("info_data", {})
    timing = data.get("bittiming", {})
    counters = data.get("berr_counter")
    return Link(
        name=str(entry["ifname"]),
        is_can=entry.get("link_type") == "can",
        kind=str(information.get("info_kind", "")),
        is_up="UP" in entry.get("flags", ()),
        queue_frames=int(entry.get("txqlen", 0)),
        state=str(data.get("state", "")),
        # controllers with a fixed bitrate report it here, and no bit timing
        bitrate=_integer(timing.get("bitrate", data.get("bittiming_bitrate"))),
        sample_point=_number(timing.get("sample_point")),  # a string since iproute2 5.16, a number before
        restart_ms=_integer(data.get("restart_ms")),
        error_counters=(int(counters["tx"]), int(counters["rx"])) if counters else None,
        control_modes=frozenset(data.get("ctrlmode", ())),
        totals={str(name): int(count) for name, count in information.get("info_xstats", {}).items()},
        receive_overruns=int(entry.get("stats64", {}).get("rx", {}).get("over_errors", 0)),
    )


def _integer(value: Any) -> int | None:
    return None if value is None else int(value)


def _number(value: Any) -> float | None:
    return None if value is None else float(value)
