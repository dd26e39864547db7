"""How regularly a message comes: its longest gap, and the mean time between two. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.conformance.rules import Ledger, Offence

if TYPE_CHECKING:
    from positioner.wire.messages import CanFrame

_NS = 1_000_000_000


@dataclass(slots=True)
class Cadence:
    """The instants of one message so far; mutable. A gap longer than a limit breaks the rule of that name."""

    ledger: Ledger
    gaps_s: dict[str, float]
    first_ns: int | None = None
    last_ns: int = 0
    steps: int = 0

    def hear(self, frame: CanFrame) -> None:
        """Take the instant of a frame."""
        if self.first_ns is None:
            self.first_ns = frame.received_ns
        else:
            self.steps += 1
            self._judge((frame.received_ns - self.last_ns) / _NS, frame)
        self.last_ns = frame.received_ns

    def end(self, now_ns: int) -> None:
        """Take the end of listening: what has not come until then has stayed away."""
        if self.first_ns is not None:
            gap_s = (now_ns - self.last_ns) / _NS
            for name, limit_s in self.gaps_s.items():
                if gap_s > limit_s:
                    self.ledger.offend(name, Offence(f"none came for {gap_s:.3f} s at the end"))

    @property
    def mean_s(self) -> float | None:
        """The mean time between two in s; None where fewer than two came."""
        if self.first_ns is None or not self.steps:
            return None
        return (self.last_ns - self.first_ns) / self.steps / _NS

    def _judge(self, gap_s: float, frame: CanFrame) -> None:
        for name, limit_s in self.gaps_s.items():
            late = f"{gap_s:.4f} s after the one before, and {limit_s:g} s are allowed"
            self.ledger.judge(name, Offence(late, frame) if gap_s > limit_s else None)
