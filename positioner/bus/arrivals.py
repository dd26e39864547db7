"""When frames arrived, and how long nobody looked: the time of a receiving loop, from receive to receive. Pure.

The kernel stamps a frame with the wall clock when it arrives, however late it is read. The stamp is carried over to the
monotonic clock by the difference of both at the reading, and believed within what must be: a frame arrived after the
queue was last seen empty, and not in the future. Where the wall clock was stepped since then, and where there is no
stamp or an absurd one, a frame counts as having come right after the queue was last seen empty.
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
"""The two clocks may drift apart by one part in this (adjtimex slews by half of it), and be read 1 ms apart."""

_LATEST_S = 1e10
"""No stamp is of later than the year 2286."""


class Arrivals:
    """Times one receiving loop. `gap_ns`: how long it was away before the last receive, or longer in it than asked."""

    def __init__(self) -> None:
        """Begin with the first receive."""
        self.gap_ns = 0
        self._left_ns: int | None = None
        self._begun_ns = 0
        self._timeout_ns = 0
        self._empty: Instant | None = None

    def begin(self, now: Instant, timeout_s: float) -> None:
        """Begin a receive that may wait for `timeout_s`."""
        self._begun_ns, self._timeout_ns = now.monotonic_ns, round(timeout_s * _NS)
        self._empty = self._empty or now

    def end(self, now: Instant) -> None:
        """End the receive."""
        away_ns = 0 if self._left_ns is None else self._begun_ns - self._left_ns
        inside_ns = now.monotonic_ns - self._begun_ns
        # who was stopped while waiting may have been so from the beginning
        late_ns = inside_ns if inside_ns > 2 * self._timeout_ns else max(inside_ns - self._timeout_ns, 0)
        self.gap_ns, self._left_ns = away_ns + late_ns, now.monotonic_ns

    def seen_empty(self, looked: Instant) -> None:
        """Remember that the queue was empty when somebody `looked`."""
        self._empty = looked

    def reopened(self, now: Instant) -> None:
        """Begin with an empty queue."""
        self._empty = now

    def arrived_ns(self, stamp_s: float, now: Instant) -> int:
        """Return the monotonic instant, in whole microseconds, at which a frame arrived that is read `now`."""
        empty = self._empty or now
        longest_ns = max(now.monotonic_ns - empty.monotonic_ns, 0)
        leeway_ns = _LEEWAY_NS + longest_ns // _SLEW
        stepped_ns = (now.wall_ns - now.monotonic_ns) - (empty.wall_ns - empty.monotonic_ns)
        age_ns = now.wall_ns - round(stamp_s * _NS) if 0.0 < stamp_s < _LATEST_S else math.inf
        if abs(stepped_ns) > leeway_ns or not -leeway_ns <= age_ns <= longest_ns + leeway_ns:
            age_ns = longest_ns
        return (now.monotonic_ns - int(min(max(age_ns, 0), longest_ns))) // _NS_PER_US * _NS_PER_US
