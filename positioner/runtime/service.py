"""Reports to the service manager: readiness, life, and the state of every valve in one line. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.machine.notify import Notifier

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.machine.time import TimePort
    from positioner.runtime.announce import Announcer

_NEXT_CYCLE_S = 5.0
"""Before the first feedback, a cycle that takes longer counts as hanging."""
WATCHDOG_EVERY_S = 0.1


class Service:
    """The daemon for its service manager; `ready` once a valid position frame of each valve has been received."""

    def __init__(self, time: TimePort) -> None:
        """Find the service manager, if there is one."""
        self._notifier = Notifier()
        self._time = time
        self.ready = False
        self._watchdog_due_s = 0.0

    def state(self, valves: Sequence[Announcer]) -> None:
        """Report the states of the valves."""
        status = in_words(valves)
        if not self.ready and all(valve.ready for valve in valves):
            self.ready = True
            self._notifier.send(READY="1", STATUS=status)
        else:
            self._notifier.send(STATUS=status)

    def alive(self) -> bool:
        """Report that every valve has had its cycle, also while feedback is waited for; return whether that was due."""
        if self._time.monotonic_s() < self._watchdog_due_s:
            return False
        self._watchdog_due_s = self._time.monotonic_s() + WATCHDOG_EVERY_S
        if self.ready:
            self._notifier.send(WATCHDOG="1")
        else:
            self._notifier.send(EXTEND_TIMEOUT_USEC=f"{_NEXT_CYCLE_S * 1e6:.0f}", WATCHDOG="1")
        return True

    def stopping(self) -> None:
        """Report that the daemon ends."""
        self._notifier.send(STOPPING="1")

    def close(self) -> None:
        """Let the service manager go."""
        self._notifier.close()


def in_words(valves: Sequence[Announcer]) -> str:
    """Return the states of the valves in one line: those in trouble first and by name, the others counted."""
    if len(valves) == 1:
        return valves[0].state
    states = sorted({(not valve.in_trouble, valve.state) for valve in valves})
    names = [[valve.name for valve in valves if (not valve.in_trouble, valve.state) == state] for state in states]
    shown = [str(len(some)) if calm else ", ".join(some) for (calm, _), some in zip(states, names, strict=True)]
    return "; ".join(f"{who} {state}" for who, (_, state) in zip(shown, states, strict=True))
