"""When each frame arrived, and for how long the loop did not receive. Pure.

The kernel stamps a frame with the wall clock when it arrives, however late it is read. The stamp is carried over to the
monotonic clock by the difference of both clocks when the frame is read, and kept within limits: a frame arrived after
the queue was last seen empty, and not in the future. Where the wall clock was stepped since then, and where the stamp
is missing or impossible, a frame counts as having arrived right after the queue was last seen empty.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from positioner.machine.time import Instant

_NS = 1_000_000_000
_NS_PER_US = 1000
_LEEWAY_NS = 1_000_000
_SLEW = 1000
"""The two clocks may drift apart by one part in this (adjtimex slews by half of it), and be read `_LEEWAY_NS` apart."""

_LATEST_S = 1e10
"""In 2286: no true stamp is later."""


class Arrivals:
    """Times one receiving loop.

    gap_ns: how long the loop was away before the last receive, plus how much longer than its timeout the receive took.
    """

    def __init__(self) -> None:
        """Begin with the first receive."""
        self.gap_ns = 0
        self._ended_ns: int | None = None
        self._began_ns = 0
        self._timeout_ns = 0
        self._empty: Instant | None = None

    def begin(self, now: Instant, timeout_s: float) -> None:
        """Begin a receive that may wait for `timeout_s`."""
        self._began_ns, self._timeout_ns = now.monotonic_ns, round(timeout_s * _NS)
        self._empty = self._empty or now

    def end(self, now: Instant) -> None:
        """End the receive."""
        away_ns = 0 if self._ended_ns is None else self._began_ns - self._ended_ns
        inside_ns = now.monotonic_ns - self._began_ns
        # a process that was stopped while it waited may have been stopped from the beginning
        late_ns = inside_ns if inside_ns > 2 * self._timeout_ns else max(inside_ns - self._timeout_ns, 0)
        self.gap_ns, self._ended_ns = away_ns + late_ns, now.monotonic_ns

    def seen_empty(self, looked: Instant) -> None:
        """Remember that the queue was empty at the instant `looked`."""
        self._empty = looked

    def reopened(self, now: Instant) -> None:
        """Remember that a queue just opened is empty."""
        self._empty = now

    def arrived_ns(self, stamp_s: float, now: Instant) -> int:
        """Return the monotonic instant, in ns and whole microseconds, at which the frame that is read `now` arrived."""
        empty = self._empty or now
        longest_ns = max(now.monotonic_ns - empty.monotonic_ns, 0)
        leeway_ns = _LEEWAY_NS + longest_ns // _SLEW
        stepped_ns = (now.wall_ns - now.monotonic_ns) - (empty.wall_ns - empty.monotonic_ns)
        age_ns = now.wall_ns - round(stamp_s * _NS) if 0.0 < stamp_s < _LATEST_S else math.inf
        if abs(stepped_ns) > leeway_ns or not -leeway_ns <= age_ns <= longest_ns + leeway_ns:
            age_ns = longest_ns
        return (now.monotonic_ns - int(min(max(age_ns, 0), longest_ns))) // _NS_PER_US * _NS_PER_US
