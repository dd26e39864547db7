"""What a bus port reports besides frames: trouble with the bus and its end, each with its line for the log. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from positioner.bus.address import BusAddress


@dataclass(frozen=True, slots=True)
class BusEvent:
    """Something happened to the bus at `address`."""

    address: BusAddress
    line: ClassVar[str]

    def __str__(self) -> str:
        """One line for the log."""
        return self.line.format(self)


@dataclass(frozen=True, slots=True)
class BusNotOpened(BusEvent):
    """The bus cannot be opened now; `error` is the text of the error, which names the bus."""

    error: str
    line = "{0.error}"


@dataclass(frozen=True, slots=True)
class BusDown(BusEvent):
    """The bus was open and does not work any more."""

    reason: str
    line = "bus {0.address} is down: {0.reason}"


@dataclass(frozen=True, slots=True)
class BusBack(BusEvent):
    """The bus works again."""

    line = "bus {0.address} is there again"


@dataclass(frozen=True, slots=True)
class SendFailed(BusEvent):
    """The bus did not take a frame."""

    reason: str
    line = "bus {0.address} did not take a frame: {0.reason}"


@dataclass(frozen=True, slots=True)
class NoFrame(BusEvent):
    """Something on an embedded bus is no CAN frame, and was dropped."""

    reason: str
    line = "bus {0.address}: something that is no CAN frame was dropped ({0.reason})"


@dataclass(frozen=True, slots=True)
class Overrun(BusEvent):
    """The receive queue was full: `count` frames were lost so far."""

    count: int
    line = (
        "bus {0.address}: the receive queue was full, {0.count} frame(s) lost so far; "
        "this process gets too little of the processor, or the bus carries too much"
    )
