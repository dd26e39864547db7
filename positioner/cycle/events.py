"""What a cycle reports besides its frames: typed events, which the shell logs, stores and draws. Pure."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from positioner.cycle.counted_event import CountedEvent
from positioner.cycle.deviation import Deviates
from positioner.cycle.hunting import Hunts
from positioner.cycle.timing_events import LawLate, PeriodWrong, Stalled
from positioner.cycle.trust_events import ActingChanged, NotBelieved, PushFailed
from positioner.cycle.vain_pushes import NoMotion
from positioner.values import dataclass
from positioner.wire.loop_current import LoopSignal, signal_of
from positioner.wire.messages import Counted
from positioner.wire.words import in_words

if TYPE_CHECKING:
    from positioner.laws.law import Decision
    from positioner.laws.move_reason import MoveReason
    from positioner.valve.state import StemState
    from positioner.valve.stiction import LearnedSample
    from positioner.wire.messages import Cause, Mode


@dataclass(frozen=True, slots=True)
class FrameRefused(CountedEvent):
    """A frame was not accepted."""

    detail: str

    def __str__(self) -> str:
        """One line for the log."""
        return f"frame refused: {self.detail}"


@dataclass(frozen=True, slots=True)
class StrayDisarm:
    """A DISARM that its counter does not put into the sequence of the host: it is obeyed, and nothing else of it."""

    counter: int
    last: int | None

    def __str__(self) -> str:
        """One line for the log."""
        return f"a DISARM that is not of the host in sequence (counter {self.counter} after {self.last}) is obeyed"


@dataclass(frozen=True, slots=True)
class FramesLost(CountedEvent):
    """The counter of a sender shows that frames are missing."""

    counted: Counted = field(default=Counted.LOST, init=False)
    sender: str

    def __str__(self) -> str:
        """One line for the log."""
        return f"{self.count} frame(s) of {self.sender} lost on the bus"


@dataclass(frozen=True, slots=True)
class SetpointRefused(CountedEvent):
    """A setpoint lies outside the travel; the last good one stays in force."""

    counted: Counted = field(default=Counted.SETPOINT_REFUSED, init=False)
    setpoint_m: float
    travel_min_m: float
    travel_max_m: float

    def __str__(self) -> str:
        """One line for the log."""
        travel = f"{self.travel_min_m * 1e3:g} to {self.travel_max_m * 1e3:g} mm"
        return (
            f"setpoint {self.setpoint_m * 1e3:.3f} mm refused: outside the travel of {travel}; "
            "the last one stays (correct the host, or valve.travel_* in the configuration)"
        )


@dataclass(frozen=True, slots=True)
class OrderDisputed(CountedEvent):
    """More than one sender seems to send setpoints, or currents by hand; `what` describes the refused one."""

    counted: Counted = field(default=Counted.DISPUTED, init=False)
    what: str
    why: str

    def __str__(self) -> str:
        """One line for the log."""
        return f"{self.what} refused: {self.why}"


@dataclass(frozen=True, slots=True)
class FeedbackRefused(CountedEvent):
    """A position reading is implausible and was not used."""

    position_m: float
    why: str

    def __str__(self) -> str:
        """One line for the log."""
        return f"position {self.position_m * 1e3:.3f} mm refused: {self.why}"


@dataclass(frozen=True, slots=True)
class ForeignCommand(CountedEvent):
    """Another controller sends our command frame."""

    counted: Counted = field(default=Counted.FOREIGN_COMMAND, init=False)
    current_ma: float
    counter: int | None = None

    def __str__(self) -> str:
        """One line for the log."""
        failure = ", a failure signal" if signal_of(self.current_ma) is LoopSignal.FAILURE else ""
        text = f"another controller commands this valve ({self.current_ma:.3f} mA{failure})"
        return f"{text}: stop it, or give one another id_offset"


@dataclass(frozen=True, slots=True)
class ModeChanged:
    """The guard changed its mode."""

    before: Mode
    after: Mode
    cause: Cause

    def __str__(self) -> str:
        """One line for the log."""
        return f"mode {self.before.name} -> {self.after.name} ({in_words(self.cause)})"


@dataclass(frozen=True, slots=True)
class Learned:
    """The table has learned a sample from a stop or a slip."""

    sample: LearnedSample
    sequence: int

    def __str__(self) -> str:
        """One line for the log."""
        sample = self.sample
        return f"learned {sample.quantity} = {sample.value:.6g} at {sample.position_m * 1e3:.2f} mm, {sample.direction}"


@dataclass(frozen=True, slots=True)
class LawFellBack:
    """The law could not do what it wanted, or failed, for the reason `why`."""

    why: str

    def __str__(self) -> str:
        """One line for the log."""
        return f"law fell back: {self.why}"


@dataclass(frozen=True, slots=True)
class LinesDropped(CountedEvent):
    """Lines of the log that were dropped: nobody read them, and the loop does not wait for a reader."""

    counted: Counted = field(default=Counted.LINE_DROPPED, init=False)


@dataclass(frozen=True, slots=True)
class MoveBegan:
    """The law began a move."""

    reason: MoveReason

    def __str__(self) -> str:
        """One line for the log."""
        return f"move: {self.reason}"


@dataclass(frozen=True, slots=True)
class Controlled:
    """One closed cycle: the reading, the estimate, the decision and the current that the guard admitted."""

    time_s: float
    setpoint_m: float
    measured_m: float
    stem: StemState
    decision: Decision
    current_ma: float
    mode: Mode
    table_sequence: int


Event = (
    FrameRefused
    | StrayDisarm
    | FramesLost
    | SetpointRefused
    | OrderDisputed
    | FeedbackRefused
    | ForeignCommand
    | Deviates
    | Hunts
    | NoMotion
    | ModeChanged
    | Learned
    | NotBelieved
    | PushFailed
    | ActingChanged
    | LawFellBack
    | LawLate
    | LinesDropped
    | Stalled
    | PeriodWrong
    | MoveBegan
    | Controlled
)


def kind_of(event: Event) -> str:
    """Return the kind of a line of the log; counted events have one kind for each cause."""
    kind = type(event).__name__
    return f"{kind}: {event.counted.text}" if isinstance(event, CountedEvent) else kind
