"""What a bus port reports besides frames: trouble with the bus and its end, each with its line for the log. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from positioner.bus.address import BusAddress


@dataclass(frozen=True, slots=True)
class BusNotOpened:
    """The bus cannot be opened now; `reason` is the whole line, as the error that says so."""

    reason: str

    def __str__(self) -> str:
        """One line for the log."""
        return self.reason


@dataclass(frozen=True, slots=True)
class BusDown:
    """The bus was open and does not work any more."""

    address: BusAddress
    reason: str

    def __str__(self) -> str:
        """One line for the log."""
        return f"bus {self.address} is down: {self.reason}"


@dataclass(frozen=True, slots=True)
class BusBack:
    """The bus works again."""

    address: BusAddress

    def __str__(self) -> str:
        """One line for the log."""
        return f"bus {self.address} is there again"


@dataclass(frozen=True, slots=True)
class SendFailed:
    """The bus did not take a frame."""

    address: BusAddress
    reason: str

    def __str__(self) -> str:
        """One line for the log."""
        return f"bus {self.address} did not take a frame: {self.reason}"


@dataclass(frozen=True, slots=True)
class NoFrame:
    """Something on an embedded bus is no CAN frame, and was dropped."""

    address: BusAddress
    reason: str

    def __str__(self) -> str:
        """One line for the log."""
        return f"bus {self.address}: something that is no CAN frame was dropped ({self.reason})"


@dataclass(frozen=True, slots=True)
class Overrun:
    """The receive queue was full: `count` frames were lost so far."""

    address: BusAddress
    count: int

    def __str__(self) -> str:
        """One line for the log."""
        return (
            f"bus {self.address}: the receive queue was full, {self.count} frame(s) lost so far; "
            "this process gets too little of the processor, or the bus carries too much"
        )


BusEvent = BusNotOpened | BusDown | BusBack | SendFailed | NoFrame | Overrun
