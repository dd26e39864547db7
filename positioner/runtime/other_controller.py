"""Whether another controller commands the valve, or only the last frames of one that has ended are still coming. Pure.

Frames wait in the transmit queue of their interface: those of a daemon that was killed are heard by the next one, and
after a bus-off they may come much later. They come without a pause and then end; a controller goes on.
"""

from __future__ import annotations

GOES_ON_NS = 2_000_000_000
"""Longer than any queue takes to drain: 1000 frames last 1.1 s at 125 kbit/s."""
_PAUSE_NS = 1_000_000_000


class OtherController:
    """Follows the commands of somebody else."""

    def __init__(self) -> None:
        """Start with none heard."""
        self._first_ns: int | None = None
        self._last_ns = 0

    def goes_on(self, heard_ns: int) -> bool:
        """Return whether the commands of which one was heard at `heard_ns` have been going on for `GOES_ON_NS`."""
        if self._first_ns is None or heard_ns - self._last_ns > _PAUSE_NS:
            self._first_ns = heard_ns
        self._last_ns = heard_ns
        return heard_ns - self._first_ns >= GOES_ON_NS
