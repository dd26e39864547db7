"""What the host knows of the valve: the newest message of each kind, and how old it is. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.cycle.handover import Handover, start_m, update_handover
from positioner.host.snapshot import Snapshot
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import (
    CurrentCommand,
    HostRequest,
    Mode,
    PositionerAlarms,
    PositionerCount,
    PositionerStatus,
    Quality,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.valve.parameters import ValveParameters
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame, Counted, Message

RECEIVED: tuple[type[Message], ...] = (
    *(StemPosition, CurrentCommand, PositionerStatus, PositionerCount, PositionerAlarms),
    Setpoint,
)
"""The messages that a host receives; a setpoint that it receives is another host's. A DISARM of another is none."""
SILENT_S = 0.5
"""A sender without a frame for so long counts as silent."""
_CONTROLLED = frozenset({Mode.ACTIVE, Mode.HOLD, Mode.MANUAL})
"""The modes of a positioner that is armed and has not failed safe."""
_NS = 1_000_000_000


class ValveView:
    """The valve as seen from the bus. Instants are monotonic; None for what was never received."""

    def __init__(self, codec: Codec, valve: ValveParameters) -> None:
        """Begin with nothing received."""
        self._codec = codec
        self.can_arm = codec.carries(Setpoint, "request")
        self._valve = valve
        self._received_ns: dict[type[Message], int] = {}
        self._track: Handover | None = None
        self.status: PositionerStatus | None = None
        self.command: CurrentCommand | None = None
        self.quality = Quality.VALID
        self.alarms: PositionerAlarms | None = None
        self.counts: dict[Counted, int] = {}
        self.other_setpoint_m: float | None = None
        self.other_counter: int | None = None

    def receive(self, frames: Iterable[CanFrame], now_ns: int) -> None:
        """Take in `frames`, oldest first: of positions and commands only the newest, of the others all."""
        newest: dict[tuple[int, bool], CanFrame] = {}
        often = {self._codec.identifier(kind) for kind in (StemPosition, CurrentCommand)}
        for frame in frames:
            identifier = frame.identifier
            if identifier in often:
                newest[identifier] = frame
            else:
                self._add(frame, now_ns)
        for frame in newest.values():
            self._add(frame, now_ns)

    def _add(self, frame: CanFrame, now_ns: int) -> None:
        try:
            message, counter = self._codec.decode(frame)
        except FrameRejectedError:
            return
        if isinstance(message, Setpoint) and message.request is HostRequest.DISARM:
            return
        self._received_ns[type(message)] = now_ns
        match message:
            case StemPosition():
                self.quality = message.quality
                if message.quality is not Quality.FAULT:
                    current_ma = self.command.current_ma if self.command else None
                    self._track = update_handover(self._track, Mode.MANUAL, message.position_m, None, current_ma)
            case CurrentCommand():
                self.command = message
            case PositionerStatus():
                self.status = message
            case PositionerCount():
                self.counts[message.counted] = message.count
            case PositionerAlarms():
                self.alarms = message
            case Setpoint():
                self.other_setpoint_m, self.other_counter = message.setpoint_m, counter

    def received_since(self, kind: type[Message], instant_ns: int) -> bool:
        """Return whether a message of this kind came after `instant_ns`."""
        return self._received_ns.get(kind, -1) > instant_ns

    def is_received(self, kind: type[Message], now_ns: int) -> bool:
        """Return whether messages of this kind come."""
        received_ns = self._received_ns.get(kind)
        return received_ns is not None and now_ns - received_ns <= SILENT_S * _NS

    def mode(self, now_ns: int) -> Mode | None:
        """Return the mode in the positioner's status, None while the positioner is silent."""
        return self.status.mode if self.status and self.is_received(PositionerStatus, now_ns) else None

    def is_controlled(self, now_ns: int) -> bool:
        """Return whether the positioner is armed and has not failed safe."""
        return self.mode(now_ns) in _CONTROLLED

    @property
    def position_m(self) -> float | None:
        """The position in m: the mean of the newest readings under one current."""
        return start_m(self._track, 0.0) if self._track and self._track.readings else None

    def snapshot(self, setpoint_m: float | None, now_ns: int) -> Snapshot:
        """Return what is known now; `setpoint_m` is the host's own, None where it sends none."""
        asked_m = setpoint_m
        if asked_m is None and self.is_received(Setpoint, now_ns):
            asked_m = self.other_setpoint_m
        return Snapshot(
            valve=self._valve.id,
            span_m=self._valve.span_m,
            status=self.status if self.is_received(PositionerStatus, now_ns) else None,
            position_m=self.position_m if self.is_received(StemPosition, now_ns) else None,
            quality=self.quality,
            setpoint_m=asked_m,
            current_ma=self.command.current_ma if self.command and self.is_received(CurrentCommand, now_ns) else None,
            alarms=self.alarms if self.is_received(PositionerAlarms, now_ns) else None,
            counts=self.counts,
        )

    def silence(self, now_ns: int) -> str:
        """Return why no status may come, in one line."""
        if not self.is_received(StemPosition, now_ns):
            return "nothing comes, neither position frames nor a status: is this the right bus, and is the plant on?"
        return (
            "position frames come, but the positioner is silent: `positioner run` does not run on this bus with this "
            "configuration"
        )
