"""How often position frames really come, held against the configured sample period. Pure.

Ages, the law's time and the bounds all count in sample periods: a period that is wrong makes them wrong, and nothing
else would say so. The median over a window is deaf to frames that were late or read together.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median

_WINDOW = 50
_TOLERANCE = 0.2
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class FramePeriod:
    """When the last position frame came, the intervals of this window in ns, and the median of the last one in s."""

    last_ns: int | None = None
    intervals_ns: tuple[float, ...] = ()
    measured_s: float | None = None

    def add(self, arrived_ns: int, lost: int) -> FramePeriod:
        """Return the frame_period after a frame that arrived at `arrived_ns`, with `lost` frames missing before it."""
        if self.last_ns is None:
            return FramePeriod(arrived_ns)
        intervals_ns = (*self.intervals_ns, (arrived_ns - self.last_ns) / (lost + 1))
        if len(intervals_ns) < _WINDOW:
            return FramePeriod(arrived_ns, intervals_ns, self.measured_s)
        return FramePeriod(arrived_ns, (), median(intervals_ns) / _NS)

    def is_wrong(self, period_s: float) -> bool:
        """Return whether the frames come at another period than `period_s`, by more than a fifth."""
        return self.measured_s is not None and abs(self.measured_s - period_s) > _TOLERANCE * period_s
