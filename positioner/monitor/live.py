"""The valves on their buses, listening only: nothing here sends a frame. Shell."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from positioner.bus.buses import Buses
from positioner.bus.events import BusBack, Overrun
from positioner.bus.port import BusPort, Ports
from positioner.config.several import by_bus
from positioner.errors import PositionerError
from positioner.monitor.kept_table import table_view
from positioner.monitor.source import Source
from positioner.store import access

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from positioner.bus.events import BusEvent
    from positioner.config.schema import Configuration
    from positioner.monitor.model import ValveModel

_WAIT_S = 0.05
_TABLE_EVERY_S = 5.0


class LiveSource(Source):
    """The valves of a configuration, and their tables where the state directories can be read from here."""

    def __init__(
        self, configurations: Sequence[Configuration], states: Mapping[str, Path], ports: Ports | None = None
    ) -> None:
        """Prepare a port to each bus; `states` are the valves' state directories."""
        super().__init__(configurations)
        ports = ports or Ports()
        self._time = ports.time
        self._states = states
        self._troubles: dict[str, str] = {}
        self._places, self._by_identifier = [], []
        for some in by_bus(configurations):
            routes: dict[tuple[int, bool], ValveModel] = {}
            for each in some:
                model = self.models[each.valve.id]
                routes |= dict.fromkeys(model.identifiers, model)
            self._by_identifier.append(routes)
            self._places.append(BusPort(some[0].bus, routes, self._report, ports))
        self._buses = Buses(self._places, ports.time)
        self._names = ", ".join(str(port.address) for port in self._places)
        self._tell()
        self._reader = threading.Thread(target=self._read_tables, name="tables", daemon=True)

    def start(self) -> None:
        """Open the buses that are there, and begin to listen.

        Raises:
            BusUnusableError: a bus cannot be used on this machine, now or later.
        """
        for port in self._places:
            port.try_open()
        super().start()
        self._reader.start()

    def close(self) -> None:
        """End, and let the buses go."""
        super().close()
        for port in self._places:
            port.close()

    def now_ns(self) -> int:
        """Return the present instant."""
        return self._time.monotonic_ns()

    def _round(self) -> None:
        batches = self._buses.receive(_WAIT_S)
        if not batches:
            return
        with self._lock:
            for number, frames in batches:
                routes = self._by_identifier[number]
                for frame in frames:
                    if frame.is_error:
                        for model in set(routes.values()):
                            model.add(frame, frame.received_ns)
                    else:
                        routes[frame.identifier].add(frame, frame.received_ns)

    def _report(self, event: BusEvent) -> None:
        """Keep what is wrong with a bus until it is there again."""
        if isinstance(event, BusBack):
            self._troubles.pop(str(event.address), None)
        elif isinstance(event, Overrun):
            self._troubles[str(event.address)] = f"this view is too slow: {event.count} frames were not seen"
        else:
            self._troubles[str(event.address)] = str(event)
        self._tell()

    def _tell(self) -> None:
        self.in_trouble = bool(self._troubles)
        self.line = "; ".join(self._troubles.values()) or f"listening on {self._names}"

    def _read_tables(self) -> None:
        """Read the stiction tables again and again: through the table writer, so that no cycle waits."""
        while not self._stopping.is_set():
            for valve, directory in self._states.items():
                try:
                    self.tables[valve] = table_view(access.dump(directory))
                except (PositionerError, OSError):
                    self.tables.pop(valve, None)
            self._stopping.wait(_TABLE_EVERY_S)
