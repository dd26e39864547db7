"""Reports the events of one valve to a person: the log, and its state in words. Shell."""

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
    StrayDisarm,
    kind_of,
)
from positioner.cycle.timing_events import LawLate
from positioner.cycle.trust_events import PushFailed
from positioner.machine.journal import Throttle, log_of
from positioner.wire.messages import Cause, Mode
from positioner.wire.words import in_words

if TYPE_CHECKING:
    from positioner.machine.time import TimePort

_SERIOUS = frozenset({Cause.FOREIGN_COMMAND, Cause.PERIOD_WRONG})
_USUAL = frozenset({Cause.NONE, Cause.MANUAL, Cause.WAITING_FOR_ARM, Cause.DISARMED})
_LATE_EVERY_S = 60.0
"""A machine that others use makes many cycles late; each is counted, and a person needs the worst of a minute."""


class Announcer:
    """Reports the events of a valve.

    ready: the first valid position frame has been received.
    state: its state in words; in_trouble: a person should look at it; changed: that has not been reported yet.
    """

    def __init__(self, name: str, time: TimePort) -> None:
        """Begin before the first cycle; the `name` stands before each line, if there is one."""
        self.name = name
        self.log = log_of(name)
        self.throttle = Throttle(time=time, log=self.log)
        self.ready = self.changed = False
        self.in_trouble = True
        self.state = "waiting for its bus"

    def tell(self, state: str, *, in_trouble: bool = True) -> None:
        """Take over a new state."""
        self.state, self.in_trouble, self.changed = state, in_trouble, True

    def cycle(self, events: tuple[Event, ...]) -> None:
        """Log the events of a cycle."""
        for event in events:
            match event:
                case Controlled():
                    pass  # a row of the trace
                case ModeChanged():
                    self._mode(event)
                case Learned() | MoveBegan() | PushFailed(rest_s=0.0):
                    self.log.debug("%s", event)
                case LinesDropped():
                    pass  # the log itself says where lines are missing
                case StrayDisarm():
                    self.throttle.log(logging.INFO, kind_of(event), str(event))
                case ForeignCommand():
                    self.throttle.log(logging.ERROR, kind_of(event), str(event))
                case LawLate():
                    size, every_s = float(event.spent_ns), _LATE_EVERY_S
                    self.throttle.log(logging.WARNING, kind_of(event), str(event), size=size, period_s=every_s)
                case _:
                    self.throttle.log(logging.WARNING, kind_of(event), str(event))

    def _mode(self, event: ModeChanged) -> None:
        troubled = {Mode.HOLD, Mode.FAILSAFE, Mode.MANUAL}
        serious = (event.after in troubled and event.cause not in {Cause.NONE, Cause.MANUAL}) or event.cause in _SERIOUS
        self.throttle.log(logging.WARNING if serious else logging.INFO, f"mode {event.after.name}", str(event))
        self.ready |= event.after is not Mode.INIT
        state = f"{event.after.name}: {in_words(event.cause)}" if event.cause is not Cause.NONE else event.after.name
        self.tell(state, in_trouble=event.cause not in _USUAL)
