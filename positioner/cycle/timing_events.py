"""Events about time: a late cycle, a wrong period of the position frames, a stall. Pure."""

from __future__ import annotations

from dataclasses import field

from positioner.cycle.counted_event import CountedEvent
from positioner.inputs.durations import duration
from positioner.values import dataclass
from positioner.wire.messages import Counted

_NS = 1e9


@dataclass(frozen=True, slots=True)
class LawLate(CountedEvent):
    """The cycle before took longer than a sample period; its command was sent late."""

    counted: Counted = field(default=Counted.LAW_LATE, init=False)
    spent_ns: int
    period_s: float

    def __str__(self) -> str:
        """One line for the log."""
        return (
            f"a cycle took {duration(self.spent_ns / _NS, 3)}, longer than the period of {duration(self.period_s)}: "
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
            f"position frames come every {duration(self.measured_s, 3)}, and control.sample_period_s is "
            f"{duration(self.period_s)}: ages and the law's time are wrong by as much; correct one of them"
        )


@dataclass(frozen=True, slots=True)
class Stalled(CountedEvent):
    """The armed process stood still, or took too long: for longer than the loop may go without feedback."""

    counted: Counted = field(default=Counted.STALLED, init=False)
    stall_ns: int

    def __str__(self) -> str:
        """One line for the log."""
        return (
            f"stood still for {duration(self.stall_ns / _NS, 3)}: the readings of that time are not acted on; "
            "give the positioner a processor of its own (systemd/realtime.conf), or a longer control.sample_period_s"
        )
