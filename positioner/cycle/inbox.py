"""From frames to their meaning: the newest valid reading, the newest usable setpoint, and all that is refused. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.cycle.events import (
    Event,
    FeedbackRefused,
    ForeignCommand,
    FrameRefused,
    FramesLost,
    OrderDisputed,
    SetpointRefused,
    StrayDisarm,
)
from positioner.cycle.link import FeedbackState, LastSetpoint, LinkState, Reading, Received
from positioner.cycle.plausibility import check_reading
from positioner.cycle.timing_events import PeriodWrong
from positioner.guard.stall import Freshness
from positioner.guard.state import GuardInput
from positioner.values import replace
from positioner.wire.e2e import CounterCheck, Sequence
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import (
    ActuatorState,
    Cause,
    Counted,
    CurrentCommand,
    HostRequest,
    ManualCurrent,
    ManualRequest,
    Message,
    Quality,
    Setpoint,
    StemPosition,
)
from positioner.wire.rounding import meant
from positioner.wire.window import Sender

if TYPE_CHECKING:
    from positioner.guard.settings import GuardSettings
    from positioner.valve.parameters import ValveParameters
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame


_SEQUENCED = (StemPosition, Setpoint, ActuatorState, ManualCurrent)
ALL_FRESH = Freshness()


def receive(
    codec: Codec,
    guard: GuardSettings,
    valve: ValveParameters,
    link: LinkState,
    frames: tuple[CanFrame, ...],
    commanded_ma: float | None = None,
    period_s: float = 0.0,
    fresh: Freshness = ALL_FRESH,
) -> Received:
    """Return the result of `frames`, oldest first; every frame is checked, and the newest reading counts.

    commanded_ma is the current that a law or a person gave, None in other modes; readings come every `period_s`. A
    reading that is older than `fresh` allows is not given to the law; the guard only receives its age.
    """
    batch = _Batch(codec, guard, valve, link, commanded_ma, period_s, fresh)
    for frame in frames:
        try:
            message, counter = codec.decode(frame)
            lost = batch.in_sequence(message, counter, codec.by_kind[type(message)].counter_modulus, frame.data)
        except FrameRejectedError as error:
            if error.counted is not None:
                batch.events.append(FrameRefused(str(error), counted=error.counted))
        else:
            batch.use(message, counter, lost, fresh.arrived_ns(frame))
    return batch.result()


class _Batch:
    """A batch of frames: the changes that they make to the link's state, collected until `result`."""

    def __init__(
        self,
        codec: Codec,
        guard: GuardSettings,
        valve: ValveParameters,
        link: LinkState,
        commanded_ma: float | None,
        period_s: float,
        fresh: Freshness,
    ) -> None:
        self.codec = codec
        self.guard = guard
        self.valve = valve
        self.commanded_ma = commanded_ma
        self.period_s = period_s
        self.fresh = fresh
        self.senders = dict(link.senders)
        self.readings = link.feedback.readings
        self.frame_period = link.feedback.frame_period
        self.position_counter = link.feedback.counter
        self.periods_unread = link.feedback.periods_unread
        self.setpoint = link.setpoint
        self.pressure_pa = link.pressure_pa
        self.pressure_is_new = link.pressure_is_new
        self.reading: Reading | None = None
        self.feedback_ns: int | None = None
        self.feedback_refused: Cause | None = None
        self.setpoint_ns: int | None = None
        self.setpoint_refused: Cause | None = None
        self.requests: list[HostRequest] = []
        self.waiting_request: HostRequest | None = None
        self.stray_disarm = False
        self.manual: ManualCurrent | None = None
        self.foreign_command = False
        self.events: list[Event] = []

    def result(self) -> Received:
        """Return the result of the batch."""
        reading, now_ns = self.reading, self.fresh.now_ns
        if reading is not None and self.pressure_is_new:
            reading = replace(reading, pressure_is_new=True)
        feedback = FeedbackState(
            readings=self.readings,
            frame_period=self.frame_period,
            counter=reading.counter if reading else self.position_counter,
            periods_unread=self.periods_unread - (reading.periods if reading else 0),
        )
        guard_input = GuardInput(
            feedback_age_ns=None if self.feedback_ns is None else now_ns - self.feedback_ns,
            feedback_refused=self.feedback_refused,
            setpoint_age_ns=None if self.setpoint_ns is None else now_ns - self.setpoint_ns,
            setpoint_refused=self.setpoint_refused,
            requests=tuple(self.requests),
            waiting_request=self.waiting_request,
            stray_disarm=self.stray_disarm,
            manual=self.manual,
            foreign_command=self.foreign_command,
        )
        link = LinkState(
            senders=self.senders,
            feedback=feedback,
            setpoint=self.setpoint,
            pressure_pa=self.pressure_pa,
            pressure_is_new=self.pressure_is_new and self.feedback_ns is None,
        )
        return Received(link, reading, guard_input, tuple(self.events))

    def in_sequence(self, message: Message, counter: int | None, modulus: int, data: bytes) -> int:
        """Check the counter and return how many frames were lost before it.

        A DISARM is obeyed whatever its counter: one too many is safe, one too few is not. One that is not in sequence
        is of another host that only disarms, or is old. It is no error: it disputes nothing and is not counted.

        Raises:
            FrameRejectedError: the counter is repeated or out of order.
        """
        if counter is None or not isinstance(message, _SEQUENCED):
            return 0
        known = self.senders.get(type(message)) or Sender(CounterCheck(modulus=modulus))
        # kept even where the frame is refused: it may be the first of a restarted sender
        self.senders[type(message)], verdict, lost = known.receive(counter, data)
        if verdict is not Sequence.FRESH:
            last = known.check.last
            if isinstance(message, Setpoint) and message.request is HostRequest.DISARM:
                self.stray_disarm = True
                self.senders[Setpoint] = replace(self.senders[Setpoint], window=known.window)
                self.events.append(StrayDisarm(counter, last))
                raise FrameRejectedError(None, "a DISARM out of sequence")  # pragma: no mutate - not counted, not told
            counted = Counted.REPEATED if verdict is Sequence.REPEATED else Counted.OUT_OF_ORDER
            raise FrameRejectedError(counted, f"{type(message).__name__} counter {counter} after {last}")
        if lost:
            self.events.append(FramesLost(type(message).__name__, count=lost))
        return lost

    def use(self, message: Message, counter: int | None, lost: int, arrived_ns: int) -> None:
        """Use a message whose frame is in order; the emulator's truth and the status of others are ignored."""
        match message:
            case StemPosition():
                self._use_position(message, counter, lost, arrived_ns)
            case Setpoint():
                self._use_setpoint(message, counter, arrived_ns)
            case ManualCurrent():
                self._use_manual(message, arrived_ns)
            case ActuatorState():
                self.pressure_pa, self.pressure_is_new = message.pressure_pa, True
            case CurrentCommand():
                self.foreign_command = True
                self.events.append(ForeignCommand(message.current_ma, counter))

    def _use_position(self, message: StemPosition, counter: int | None, lost: int, arrived_ns: int) -> None:
        self.periods_unread += lost + 1
        before, self.frame_period = self.frame_period, self.frame_period.add(arrived_ns, lost)
        measured_s = self.frame_period.measured_s
        if measured_s is not None and measured_s != before.measured_s and self.frame_period.is_wrong(self.period_s):
            self.events.append(PeriodWrong(measured_s, self.period_s))
        if (sender := self.senders.get(StemPosition)) is not None and not sender.window.settled:
            self.events.append(FeedbackRefused(message.position_m, sender.window.why, counted=Counted.DISPUTED))
            self.feedback_refused = self.feedback_refused if sender.window.valid else Cause.FEEDBACK_DISPUTED
            return
        elapsed_s = (lost + 1) * self.period_s
        self.readings, refusal = check_reading(
            self.guard, self.valve, self.readings, message, self.commanded_ma, elapsed_s, self.period_s
        )
        if refusal:
            self.events.append(FeedbackRefused(message.position_m, refusal.why, counted=refusal.counted))
            frozen = refusal.counted is Counted.FEEDBACK_FROZEN
            self.feedback_refused = Cause.FEEDBACK_FROZEN if frozen else Cause.FEEDBACK_IMPLAUSIBLE
            return
        self.feedback_ns = arrived_ns
        fresh = arrived_ns >= self.fresh.readings_since_ns
        obeys = message.quality is not Quality.FAIL_POSITION
        reading = Reading(message.position_m, counter, message.command_counter, self.periods_unread, obeys)
        self.reading = reading if fresh else None

    def _use_manual(self, message: ManualCurrent, arrived_ns: int) -> None:
        sender = self.senders.get(ManualCurrent)
        if sender is None or sender.window.valid:
            if message.request is ManualRequest.AUTO or arrived_ns >= self.fresh.orders_since_ns:
                self.manual = message
        else:
            self.events.append(OrderDisputed(f"current {message.current_ma:.3f} mA by hand", sender.window.why))

    def _use_setpoint(self, message: Setpoint, counter: int | None, arrived_ns: int) -> None:
        if (sender := self.senders.get(Setpoint)) is not None and not sender.window.valid:
            self.stray_disarm |= message.request is HostRequest.DISARM
            self.setpoint_refused = Cause.SETPOINT_DISPUTED
            what = f"setpoint {message.setpoint_m * 1e3:.3f} mm"
            self.events.append(OrderDisputed(what, sender.window.why))
            return
        low_m, high_m = self.valve.travel_min_m, self.valve.travel_max_m
        setpoint_m = meant(self.codec.field(Setpoint, "setpoint_m"), message.setpoint_m, low_m, high_m)
        usable = setpoint_m is not None
        # an ARM counts with a setpoint that can be used
        if usable or message.request is not HostRequest.ARM:
            self._use_request(message.request, arrived_ns)
        if usable:
            self.setpoint_ns, self.setpoint = arrived_ns, LastSetpoint(setpoint_m, counter)
        else:
            self.events.append(SetpointRefused(message.setpoint_m, low_m, high_m))

    def _use_request(self, request: HostRequest, arrived_ns: int) -> None:
        if request is not HostRequest.DISARM and arrived_ns < self.fresh.orders_since_ns:
            self.waiting_request = request
        elif [request] != self.requests[-1:]:
            self.requests.append(request)
