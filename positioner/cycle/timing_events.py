"""What a cycle reports of the time that the process took. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field

from positioner.cycle.counted_event import CountedEvent
from positioner.wire.messages import Counted


@dataclass(frozen=True, slots=True)
class LawLate(CountedEvent):
    """The turn of the loop before took longer than a sample period; its command left late."""

    counted: Counted = field(default=Counted.LAW_LATE, init=False)
    spent_ns: int
    period_s: float

    def __str__(self) -> str:
        """One line for the log."""
        return (
            f"a turn took {self.spent_ns / 1e6:.3g} ms, longer than the period of {self.period_s * 1e3:g} ms: "
            "give the positioner a processor of its own, or a longer control.sample_period_s"
        )


@dataclass(frozen=True, slots=True)
class PeriodWrong:
    """Position frames come at another period than the configured one."""

    measured_s: float
    period_s: float

    def __str__(self) -> str:
        """One line for the log."""
        return (
            f"position frames come every {self.measured_s * 1e3:.3g} ms, and control.sample_period_s says "
            f"{self.period_s * 1e3:g} ms: ages and the law's time are wrong by as much; mend one of them"
        )


@dataclass(frozen=True, slots=True)
class Stalled(CountedEvent):
    """The process stood still, or took too long, while it was armed: longer than HOLD tolerates without feedback."""

    counted: Counted = field(default=Counted.STALLED, init=False)
    stall_ns: int

    def __str__(self) -> str:
        """One line for the log."""
        return (
            f"stood still for {self.stall_ns / 1e6:.3g} ms: what waited meanwhile is not acted on; "
            "give the positioner a processor of its own (systemd/realtime.conf), or a longer control.sample_period_s"
        )
