"""Who is told what a cycle did: the log, the trace, the service manager. Shell."""

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
from positioner.errors import AnotherControllerError
from positioner.machine.journal import Throttle, logger
from positioner.machine.notify import Notifier
from positioner.runtime.other_controller import OtherController
from positioner.wire.messages import Cause, Mode

if TYPE_CHECKING:
    from positioner.machine.time import TimePort
    from positioner.runtime.trace import TraceWriter

_NEXT_TURN_S = 5.0
"""Before the first feedback: a turn that takes longer hangs."""


_SERIOUS = frozenset({Cause.FOREIGN_COMMAND, Cause.PERIOD_WRONG})


class Announcer:
    """Tells the world; `ready` once a first valid position frame has been seen."""

    def __init__(self, time: TimePort) -> None:
        """Find the service manager, if there is one; no trace is written until one is given."""
        self.throttle = Throttle(time=time)
        self.notifier = Notifier()
        self.trace: TraceWriter | None = None
        self.ready = False
        self._other = OtherController()

    def alive(self) -> None:
        """Tell the service manager that a turn is complete, also while the first feedback is waited for without end.

        The log gets what was held back for its second.
        """
        self.throttle.flush()
        if self.ready:
            self.notifier.send(WATCHDOG="1")
        else:
            self.notifier.send(EXTEND_TIMEOUT_USEC=f"{_NEXT_TURN_S * 1e6:.0f}", WATCHDOG="1")

    def tell(self, events: tuple[Event, ...], now_ns: int, *, ever_armed: bool) -> None:
        """Tell of the events of the cycle at `now_ns`.

        Raises:
            AnotherControllerError: another controller goes on commanding this valve, and this one was never armed.
        """
        learned = [event for event in events if isinstance(event, Learned)]
        for event in events:
            match event:
                case Controlled():
                    self._draw(event, learned)
                case ModeChanged():
                    self._announce(event)
                case Learned() | MoveBegan() | PushFailed(rest_s=0.0):
                    logger.debug("%s", event)
                case LinesDropped():
                    pass  # the log itself tells where they are missing
                case ForeignCommand():
                    self.throttle.log(logging.ERROR, type(event).__name__, str(event))
                    if self._other.goes_on(now_ns) and not ever_armed:
                        raise AnotherControllerError(f"not started: {event}")
                case _:
                    self.throttle.log(logging.WARNING, kind_of(event), str(event))

    def _draw(self, cycle: Controlled, learned: list[Learned]) -> None:
        """Write one row of the trace; a disk that takes no more ends the trace, never the loop."""
        try:
            if self.trace:
                self.trace.write(cycle, learned)
        except OSError as error:
            self.end_trace(f"the trace ends here: {error.strerror}")

    def end_trace(self, complaint: str = "") -> None:
        """Close the trace, if there is one, with a line where there is something to complain of."""
        trace, self.trace = self.trace, None
        try:
            if trace:
                trace.close()
        except OSError as error:
            complaint = complaint or f"the trace lacks its end: {error.strerror}"
        if complaint:
            logger.error("%s", complaint)

    def _announce(self, event: ModeChanged) -> None:
        troubled = {Mode.HOLD, Mode.FAILSAFE, Mode.MANUAL}
        serious = (event.after in troubled and event.cause not in {Cause.NONE, Cause.MANUAL}) or event.cause in _SERIOUS
        self.throttle.log(logging.WARNING if serious else logging.INFO, f"mode {event.after.name}", str(event))
        cause = event.cause.name.lower().replace("_", " ")
        status = f"{event.after.name}: {cause}" if event.cause is not Cause.NONE else event.after.name
        if event.after is not Mode.INIT and not self.ready:
            self.ready = True
            self.notifier.send(READY="1", STATUS=status)
        else:
            self.notifier.send(STATUS=status)
