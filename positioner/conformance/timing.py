"""The timing of the frames of one message: the gaps between them, and the mean period. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.conformance.rules import Results, Violation

if TYPE_CHECKING:
    from positioner.wire.messages import CanFrame

_NS = 1_000_000_000


@dataclass(slots=True)
class FrameTiming:
    """The timing of one message so far; mutable. `gaps_s` holds the longest gap that each rule allows."""

    results: Results
    gaps_s: dict[str, float]
    first_ns: int | None = None
    last_ns: int = 0
    periods: int = 0

    def receive(self, frame: CanFrame) -> None:
        """Check the gap before `frame`."""
        if self.first_ns is None:
            self.first_ns = frame.received_ns
        else:
            self.periods += 1
            gap_s = (frame.received_ns - self.last_ns) / _NS
            for name, limit_s in self.gaps_s.items():
                late = f"{gap_s:.4f} s after the frame before, and {limit_s:g} s are allowed"
                self.results.note(name, Violation(late, frame) if gap_s > limit_s else None)
        self.last_ns = frame.received_ns

    def end(self, now_ns: int) -> None:
        """Check the gap between the last frame and the end of the test."""
        if self.first_ns is not None:
            gap_s = (now_ns - self.last_ns) / _NS
            for name, limit_s in self.gaps_s.items():
                if gap_s > limit_s:
                    self.results.failed(name, Violation(f"no frame in the last {gap_s:.3f} s of the test"))

    @property
    def mean_s(self) -> float | None:
        """The mean period in s; None where fewer than two frames came."""
        if self.first_ns is None or not self.periods:
            return None
        return (self.last_ns - self.first_ns) / self.periods / _NS
