"""A clock in the place of the machine's: it stands still but for what its user adds."""

from __future__ import annotations

from positioner.machine.time import Instant


class StillClock:
    """The instants of `positioner.machine.time`, all of one number."""

    def __init__(self) -> None:
        self.now_ns = 5_000_000_000_000

    def pass_time(self, duration_s: float) -> None:
        self.now_ns += round(duration_s * 1e9)

    def instant(self) -> Instant:
        return Instant(self.now_ns, self.now_ns)

    def monotonic_ns(self) -> int:
        return self.now_ns

    def monotonic_s(self) -> float:
        return self.now_ns / 1e9
