"""The doors of the daemon's loop to the world: its clocks, and the bus. A test may put its own behind them. Shell."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from positioner.machine.time import MachineTime, TimePort

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    import can

    from positioner.bus.address import BusAddress

    OpenBus = Callable[[BusAddress, Iterable[tuple[int, bool]]], can.BusABC]


@dataclass(frozen=True, slots=True)
class Ports:
    """The machine's clocks, and what opens a bus (as `opening.open_bus`, which None stands for)."""

    time: TimePort = field(default_factory=MachineTime)
    open_bus: OpenBus | None = None
