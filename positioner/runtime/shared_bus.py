"""One bus and the valves on it: each frame goes to the valve that its identifier belongs to. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.bus.port import BusPort, Ports

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from positioner.bus.address import BusAddress
    from positioner.bus.events import BusEvent
    from positioner.config.schema import Configuration
    from positioner.runtime.session import Session
    from positioner.wire.messages import CanFrame

WAITING = "waiting for position frames"
"""What a service reports until its first cycle."""


class SharedBus:
    """The port to one bus, and the sessions of the valves on it."""

    def __init__(
        self, address: BusAddress, sessions: Sequence[Session], report: Callable[[BusEvent], None], ports: Ports
    ) -> None:
        """Give the sessions their port."""
        self._sessions = tuple(sessions)
        self._by_identifier = {identifier: (session,) for session in sessions for identifier in session.identifiers}
        self.port = BusPort(address, self._by_identifier, report, ports)
        for session in sessions:
            session.port = self.port
            if session.announcer.name:
                self.port.room_within_s = 0.0  # the other valves would wait, too
        self._was_open = False

    def by_valve(self, frames: tuple[CanFrame, ...]) -> Iterable[tuple[Session, tuple[CanFrame, ...]]]:
        """Return each session with its frames, in the order of the first frame; an error frame is everyone's."""
        if len(self._sessions) == 1:
            return ((self._sessions[0], frames),)
        own: dict[Session, list[CanFrame]] = {}
        for frame in frames:
            for session in self._sessions if frame.is_error else self._by_identifier[frame.identifier]:
                own.setdefault(session, []).append(frame)
        return [(session, tuple(some)) for session, some in own.items() if not session.ended]

    def announce_open(self) -> bool:
        """Return whether the bus has been opened for the first time; its valves then wait for their frames."""
        if self._was_open or not self.port.is_open:
            return False
        self._was_open = True
        for session in self._sessions:
            session.announcer.tell(f"{WAITING} on {self.port.address}")
        return True


def shared_buses(
    configurations: Sequence[Configuration],
    sessions: Sequence[Session],
    report: Callable[[BusEvent], None],
    ports: Ports,
) -> tuple[SharedBus, ...]:
    """Return a bus for each place in the configurations, with the sessions of the valves there."""
    by_place: dict[tuple[str, str, int], list[int]] = {}
    for number, configuration in enumerate(configurations):
        by_place.setdefault(configuration.bus.place, []).append(number)
    return tuple(
        SharedBus(configurations[numbers[0]].bus, [sessions[number] for number in numbers], report, ports)
        for numbers in by_place.values()
    )
