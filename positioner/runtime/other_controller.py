"""Another controller that goes on commanding this valve ends a positioner that was never armed. Pure.

Frames wait in the transmit queue of their interface: those of a daemon that was killed reach the next daemon, and after
a bus-off they may come much later. Such frames come without a pause and then end; a controller goes on.
"""

from __future__ import annotations

from positioner.cycle.events import Event, ForeignCommand
from positioner.errors import AnotherControllerError

GOES_ON_NS = 2_000_000_000
"""Longer than any queue takes to drain: 1000 frames last 1.1 s at 125 kbit/s."""
_PAUSE_NS = 1_000_000_000


class OtherController:
    """Follows the commands of another controller."""

    def __init__(self) -> None:
        """Start before the first command."""
        self._first_ns: int | None = None
        self._last_ns = 0

    def check(self, events: tuple[Event, ...], now_ns: int, *, ever_armed: bool) -> None:
        """Follow the foreign commands among the events of the cycle at `now_ns`.

        Raises:
            AnotherControllerError: another controller goes on, and this positioner was never armed.
        """
        for event in events:
            if isinstance(event, ForeignCommand) and self.goes_on(now_ns) and not ever_armed:
                raise AnotherControllerError(f"not started: {event}")

    def goes_on(self, received_ns: int) -> bool:
        """Return whether the commands, of which one came at `received_ns`, have been going on for `GOES_ON_NS`."""
        if self._first_ns is None or received_ns - self._last_ns > _PAUSE_NS:
            self._first_ns = received_ns
        self._last_ns = received_ns
        return received_ns - self._first_ns >= GOES_ON_NS
