"""The frames of a log: which of them the positioner received, which it sent, and which do not concern it. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from positioner.runtime.record import NOTE_ID
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import (
    ActuatorState,
    CurrentCommand,
    ManualCurrent,
    PositionerStatus,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from positioner.replay.log import LogFrame
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

M = TypeVar("M", CurrentCommand, PositionerStatus)

INPUTS = (StemPosition, ActuatorState, Setpoint, ManualCurrent, CurrentCommand)
"""Messages that a positioner receives; a command that it receives is another controller's."""
_NOTE_BYTES = 8
MOST_FRAMES = 4096
"""Most frames of one cycle (`positioner.bus.port` receives at most 1024), and of the look-ahead in a log."""


@dataclass(frozen=True, slots=True)
class RecordedCycle:
    """One cycle of the positioner: its instant, the frames it received and sent, and the notes of its record."""

    time_ns: int
    inbox: tuple[LogFrame, ...]
    outbox: tuple[LogFrame, ...] = ()
    notes: tuple[LogFrame, ...] = ()


class FrameClassifier:
    """Classifies the frames of one valve by their identifiers."""

    def __init__(self, codec: Codec) -> None:
        """Read the identifiers from the DBC; the positioner is the sender of the status."""
        self.codec = codec
        own = set(codec.by_kind[PositionerStatus].dbc.senders)
        sent = [kind for kind, form in codec.by_kind.items() if own & set(form.dbc.senders)]
        self._outputs = {codec.identifier(kind) for kind in (*sent, CurrentCommand)}
        self._inputs = {codec.identifier(kind) for kind in INPUTS}
        self._command = codec.identifier(CurrentCommand)
        self._position = codec.identifier(StemPosition)
        self._setpoint = codec.identifier(Setpoint)

    def concerns(self, logged: LogFrame) -> bool:
        """Return whether the positioner receives or sends such a frame, or writes it as a note into its record."""
        is_note = logged.sent and _address(logged) == (NOTE_ID, True) and len(logged.frame.data) == _NOTE_BYTES
        return self.is_input(logged) or self.is_output(logged) or is_note

    def is_input(self, logged: LogFrame) -> bool:
        """Return whether the positioner receives such a frame; every node receives error frames."""
        return logged.frame.is_error or _address(logged) in self._inputs

    def is_output(self, logged: LogFrame) -> bool:
        """Return whether a positioner sends such a frame."""
        return not logged.frame.is_error and _address(logged) in self._outputs

    def is_command(self, logged: LogFrame) -> bool:
        """Return whether it is a command, of this positioner or of another controller."""
        return not logged.frame.is_error and _address(logged) == self._command

    def is_position(self, logged: LogFrame) -> bool:
        """Return whether it is a valid position frame."""
        return _address(logged) == self._position and self._is_valid(logged)

    def is_setpoint(self, logged: LogFrame) -> bool:
        """Return whether it is a valid setpoint frame."""
        return _address(logged) == self._setpoint and self._is_valid(logged)

    def counter(self, logged: LogFrame) -> int | None:
        """Return the counter of a frame, valid or not, or None if it has none."""
        form = self.codec.by_id[_address(logged)]
        return self._raw(logged).get(form.counter) if form.counter else None

    def echo(self, logged: LogFrame, field: str) -> int | None:
        """Return the counter that a command echoes in `field`, or None if the DBC has no such signal."""
        form = self.codec.by_kind[CurrentCommand]
        signal = next((each.signal for each in form.fields if each.name == field), None)
        return self._raw(logged).get(signal) if signal else None

    def _raw(self, logged: LogFrame) -> dict[str, Any]:
        form = self.codec.by_id[_address(logged)]
        if len(logged.frame.data) != form.dbc.length:
            return {}
        return form.dbc.decode(logged.frame.data, decode_choices=False, scaling=False)  # type: ignore[return-value]

    def _is_valid(self, logged: LogFrame) -> bool:
        try:
            self.codec.decode(logged.frame)
        except FrameRejectedError:
            return False
        return True


def first_in(codec: Codec, kind: type[M], frames: Iterable[CanFrame]) -> tuple[M, int | None] | None:
    """Return the first valid message of a kind among `frames` with its counter, or None."""
    identifier = codec.identifier(kind)
    for frame in frames:
        if (frame.arbitration_id, frame.is_extended) != identifier:
            continue
        try:
            message, counter = codec.decode(frame)
        except FrameRejectedError:
            continue
        if isinstance(message, kind):
            return message, counter
    return None


def command_in(codec: Codec, frames: Iterable[CanFrame]) -> tuple[CurrentCommand, int | None] | None:
    """Return the first valid command among `frames` with its counter, or None."""
    return first_in(codec, CurrentCommand, frames)


def _address(logged: LogFrame) -> tuple[int, bool]:
    return logged.frame.arbitration_id, logged.frame.is_extended
