"""Reports to a person and to the service manager: the log, and the state of the daemon. Shell."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from positioner.cycle.events import (
    Controlled,
    Event,
    ForeignCommand,
    Learned,
    LinesDropped,
    ModeChanged,
    MoveBegan,
    kind_of,
)
from positioner.cycle.trust_events import PushFailed
from positioner.machine.journal import Throttle, logger
from positioner.machine.notify import Notifier
from positioner.wire.messages import Cause, Mode

if TYPE_CHECKING:
    from positioner.bus.address import BusAddress
    from positioner.bus.events import BusEvent
    from positioner.machine.time import TimePort

_NEXT_CYCLE_S = 5.0
"""Before the first feedback, a cycle that takes longer counts as hanging."""
_WATCHDOG_EVERY_S = 0.1
_SERIOUS = frozenset({Cause.FOREIGN_COMMAND, Cause.PERIOD_WRONG})


class Announcer:
    """Reports events; `ready` once a first valid position frame has been received."""

    def __init__(self, time: TimePort) -> None:
        """Find the service manager, if there is one."""
        self.throttle = Throttle(time=time)
        self.ready = False
        self._notifier = Notifier()
        self._time = time
        self._watchdog_due_s = 0.0

    def waiting(self, address: BusAddress) -> None:
        """Report to the service manager that the bus is open, as long as no feedback has come."""
        if not self.ready:
            self._notifier.send(STATUS=f"waiting for position frames on {address}")

    def alive(self) -> None:
        """Report to the service manager that a cycle is complete, also while the first feedback is waited for.

        Lines that were held back for their second are logged.
        """
        if self._time.monotonic_s() < self._watchdog_due_s:
            return
        self._watchdog_due_s = self._time.monotonic_s() + _WATCHDOG_EVERY_S
        self.throttle.flush()
        if self.ready:
            self._notifier.send(WATCHDOG="1")
        else:
            self._notifier.send(EXTEND_TIMEOUT_USEC=f"{_NEXT_CYCLE_S * 1e6:.0f}", WATCHDOG="1")

    def stopping(self) -> None:
        """Report to the service manager that the daemon ends."""
        self._notifier.send(STOPPING="1")

    def close(self) -> None:
        """Log every line that was held back, and let the service manager go."""
        self.throttle.flush(all_of_them=True)
        self._notifier.close()

    def bus(self, event: BusEvent) -> None:
        """Log an event of the bus."""
        self.throttle.log(logging.WARNING, type(event).__name__, str(event))

    def cycle(self, events: tuple[Event, ...]) -> None:
        """Log the events of a cycle."""
        for event in events:
            match event:
                case Controlled():
                    pass  # a row of the trace
                case ModeChanged():
                    self._mode(event)
                case Learned() | MoveBegan() | PushFailed(rest_s=0.0):
                    logger.debug("%s", event)
                case LinesDropped():
                    pass  # the log itself says where lines are missing
                case ForeignCommand():
                    self.throttle.log(logging.ERROR, kind_of(event), str(event))
                case _:
                    self.throttle.log(logging.WARNING, kind_of(event), str(event))

    def _mode(self, event: ModeChanged) -> None:
        troubled = {Mode.HOLD, Mode.FAILSAFE, Mode.MANUAL}
        serious = (event.after in troubled and event.cause not in {Cause.NONE, Cause.MANUAL}) or event.cause in _SERIOUS
        self.throttle.log(logging.WARNING if serious else logging.INFO, f"mode {event.after.name}", str(event))
        cause = event.cause.name.lower().replace("_", " ")
        status = f"{event.after.name}: {cause}" if event.cause is not Cause.NONE else event.after.name
        if event.after is not Mode.INIT and not self.ready:
            self.ready = True
            self._notifier.send(READY="1", STATUS=status)
        else:
            self._notifier.send(STATUS=status)
