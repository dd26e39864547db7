"""The measured period of the position frames, compared with the configured sample period. Pure.

Ages, the law's time and the bounds all count in sample periods: with a wrong period they are wrong, and nothing else
would show it. A median over a window does not react to frames that were late or read together.
"""

from __future__ import annotations

from statistics import median

from positioner.values import dataclass

_WINDOW = 50
_TOLERANCE = 0.2
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class FramePeriod:
    """When the last position frame came, the intervals of this window in ns, and the median of the last window in s."""

    last_ns: int | None = None
    intervals_ns: tuple[float, ...] = ()
    measured_s: float | None = None

    def add(self, arrived_ns: int, lost: int) -> FramePeriod:
        """Return the period after a frame that arrived at `arrived_ns`, with `lost` frames missing before it."""
        if self.last_ns is None:
            return FramePeriod(last_ns=arrived_ns)
        intervals_ns = (*self.intervals_ns, (arrived_ns - self.last_ns) / (lost + 1))
        if len(intervals_ns) < _WINDOW:
            return FramePeriod(last_ns=arrived_ns, intervals_ns=intervals_ns, measured_s=self.measured_s)
        return FramePeriod(last_ns=arrived_ns, measured_s=median(intervals_ns) / _NS)

    def is_wrong(self, period_s: float) -> bool:
        """Return whether the frames come at another period than `period_s`, by more than a fifth."""
        return self.measured_s is not None and abs(self.measured_s - period_s) > _TOLERANCE * period_s
