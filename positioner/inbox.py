"""From frames to what they mean: the newest valid reading, the newest usable setpoint, and everything refused. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from positioner.events import (
    Event,
    FeedbackRefused,
    ForeignCommand,
    FrameRefused,
    FramesLost,
    SetpointDisputed,
    SetpointRefused,
)
from positioner.guard_state import Sighting
from positioner.plausibility import Watched, judge
from positioner.wire.e2e import CounterCheck, Sequence
from positioner.wire.formats import FrameRejectedError, Reason
from positioner.wire.messages import (
    ActuatorState,
    Cause,
    Counted,
    CurrentCommand,
    HostRequest,
    ManualCurrent,
    Message,
    Setpoint,
    StemPosition,
)
from positioner.wire.window import Sender

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.guard_settings import GuardSettings
    from positioner.model import ValveParameters
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame


@dataclass(frozen=True, slots=True)
class LinkState:
    """What is remembered of the other nodes between cycles."""

    senders: Mapping[type[Message], Sender] = field(default_factory=dict)
    readings: Watched = field(default_factory=Watched)
    setpoint_m: float | None = None
    setpoint_counter: int | None = None
    pressure_pa: float | None = None
    rejected_count: int = 0
    periods_unread: int = 0
    position_counter: int | None = None


@dataclass(frozen=True, slots=True)
class Reading:
    """A plausible position reading: its frame's counter, and how many sample periods lie between it and the last."""

    position_m: float
    counter: int | None
    command_counter: int | None
    periods: int


@dataclass(frozen=True, slots=True)
class Received:
    """What a batch of frames amounts to."""

    link: LinkState
    reading: Reading | None
    seen: Sighting
    events: tuple[Event, ...]


_IGNORED = frozenset({Reason.UNKNOWN_ID})
"""Other nodes' traffic is nobody's mistake."""
_COUNTED = (StemPosition, Setpoint, ActuatorState, ManualCurrent)


def receive(
    codec: Codec,
    guard: GuardSettings,
    valve: ValveParameters,
    link: LinkState,
    frames: tuple[CanFrame, ...],
    commanded_ma: float | None = None,
    period_s: float = 0.0,
) -> Received:
    """Return what `frames`, oldest first, amount to; the newest reading counts, no frame is lost to the checks.

    commanded_ma is the current that a law or a person gave, None in other modes; `period_s` lies between two readings.
    """
    batch = _Batch(guard, valve, link, commanded_ma, period_s)
    for frame in frames:
        try:
            message, counter = codec.decode(frame)
            lost = batch.in_sequence(message, counter, codec.by_kind[type(message)].counter_modulus, frame.data)
        except FrameRejectedError as error:
            if error.reason not in _IGNORED:
                batch.rejected_count += 1
                batch.events.append(FrameRefused(error.reason, str(error)))
        else:
            batch.take(message, counter, lost)
    return batch.result()


class _Batch:
    """A batch of frames on its way to being understood: the link's fields, writable until `result`."""

    def __init__(
        self, guard: GuardSettings, valve: ValveParameters, link: LinkState, commanded_ma: float | None, period_s: float
    ) -> None:
        self.guard = guard
        self.valve = valve
        self.commanded_ma = commanded_ma
        self.period_s = period_s
        self.senders = dict(link.senders)
        self.readings = link.readings
        self.setpoint_m = link.setpoint_m
        self.setpoint_counter = link.setpoint_counter
        self.pressure_pa = link.pressure_pa
        self.rejected_count = link.rejected_count
        self.position_counter = link.position_counter
        self.reading: Reading | None = None
        self.setpoint = False
        self.requests: list[HostRequest] = []
        self.manual: ManualCurrent | None = None
        self.stray_disarm = False
        self.foreign = False
        self.refused: Cause | None = None
        self.setpoint_refused: Cause | None = None
        self.events: list[Event] = []
        self._periods = link.periods_unread

    def result(self) -> Received:
        """Return what the batch amounts to."""
        link = LinkState(
            self.senders,
            self.readings,
            self.setpoint_m,
            self.setpoint_counter,
            self.pressure_pa,
            self.rejected_count,
            self._periods - (self.reading.periods if self.reading else 0),
            self.reading.counter if self.reading else self.position_counter,
        )
        seen = Sighting(
            self.reading is not None,
            self.setpoint,
            tuple(self.requests),
            self.foreign,
            self.refused,
            manual=self.manual,
            stray_disarm=self.stray_disarm,
            setpoint_refused=self.setpoint_refused,
        )
        return Received(link, self.reading, seen, tuple(self.events))

    def in_sequence(self, message: Message, counter: int | None, modulus: int, data: bytes) -> int:
        """Take the counter over and return how many frames were lost before it.

        A DISARM is obeyed whatever the counter of its frame: one too many is safe, one too few is not.

        Raises:
            FrameRejectedError: the counter is repeated or out of order.
        """
        if counter is None or not isinstance(message, _COUNTED):
            return 0
        known = self.senders.get(type(message)) or Sender(CounterCheck(modulus=modulus))
        # kept even when refused: the frame may be the first of a restarted sender
        self.senders[type(message)], verdict, lost = known.hear(counter, data)
        if verdict is not Sequence.FRESH:
            disarms = isinstance(message, Setpoint) and message.request is HostRequest.DISARM
            self.stray_disarm |= disarms
            reason = Reason.REPEATED if verdict is Sequence.REPEATED else Reason.OUT_OF_ORDER
            told = f"{type(message).__name__} counter {counter} after {known.check.last}"
            raise FrameRejectedError(reason, f"{told}; its DISARM is obeyed" if disarms else told)
        if lost:
            self.events.append(FramesLost(type(message).__name__, lost))
        return lost

    def take(self, message: Message, counter: int | None, lost: int) -> None:
        """Take a message whose frame is in order; the emulator's truth and others' status are not ours to read."""
        match message:
            case StemPosition():
                self._take_position(message, counter, lost)
            case Setpoint():
                self._take_setpoint(message, counter)
            case ManualCurrent():
                sender = self.senders.get(ManualCurrent)
                self.manual = message if sender is None or sender.window.valid else self.manual
            case ActuatorState():
                self.pressure_pa = message.pressure_pa
            case CurrentCommand():
                self.foreign = True
                self.events.append(ForeignCommand(message.current_ma))

    def _take_position(self, message: StemPosition, counter: int | None, lost: int) -> None:
        self._periods += lost + 1
        if (sender := self.senders.get(StemPosition)) is not None and not sender.window.settled:
            self.events.append(FeedbackRefused(message.position_m, sender.window.why, Counted.DISPUTED))
            self.refused = Cause.FEEDBACK_DISPUTED
            return
        elapsed_s = (lost + 1) * self.period_s
        self.readings, doubt = judge(
            self.guard, self.valve, self.readings, message, self.commanded_ma, elapsed_s, self.period_s
        )
        if doubt:
            self.events.append(FeedbackRefused(message.position_m, doubt.why, doubt.counted))
            frozen = doubt.counted is Counted.FEEDBACK_FROZEN
            self.refused = Cause.FEEDBACK_FROZEN if frozen else Cause.FEEDBACK_IMPLAUSIBLE
        else:
            self.reading = Reading(message.position_m, counter, message.command_counter, self._periods)

    def _take_setpoint(self, message: Setpoint, counter: int | None) -> None:
        if (sender := self.senders.get(Setpoint)) is not None and not sender.window.valid:
            self.stray_disarm |= message.request is HostRequest.DISARM
            self.setpoint_refused = Cause.SETPOINT_DISPUTED
            self.events.append(SetpointDisputed(message.setpoint_m, sender.window.why))
            return
        usable = self.valve.travel_min_m <= message.setpoint_m <= self.valve.travel_max_m
        # an ARM counts with a setpoint that can be used
        if (usable or message.request is not HostRequest.ARM) and [message.request] != self.requests[-1:]:
            self.requests.append(message.request)
        if usable:
            self.setpoint, self.setpoint_m, self.setpoint_counter = True, message.setpoint_m, counter
        else:
            refused = SetpointRefused(message.setpoint_m, self.valve.travel_min_m, self.valve.travel_max_m)
            self.events.append(refused)
