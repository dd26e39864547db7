"""What a frame of a log is to the positioner: something it hears, something it sent, or nothing to it. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

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
    from positioner.replay.log import LogFrame
    from positioner.wire.codec import Codec

INPUTS = (StemPosition, ActuatorState, Setpoint, ManualCurrent, CurrentCommand)
"""What a positioner hears; a command that it hears is somebody else's."""
NOTE_ID = 0x1FFFFFFF
"""Identifier of a note in the positioner's own record (`positioner.runtime.record`)."""
_NOTE_BYTES = 8
MOST_FRAMES = 4096
"""Frames of one cycle at most (a real one: 1024, `positioner.bus.port`), and frames that are looked ahead in a log."""


@dataclass(frozen=True, slots=True)
class RecordedCycle:
    """One cycle of the positioner's loop: its instant, what it took in, what it sent, and what else it was told."""

    time_ns: int
    inbox: tuple[LogFrame, ...]
    outbox: tuple[LogFrame, ...] = ()
    notes: tuple[LogFrame, ...] = ()


class FrameClassifier:
    """Tells the frames of one valve apart, by their identifiers."""

    def __init__(self, codec: Codec) -> None:
        """Learn who sends what: the command's sender is the positioner, and it sends all that the DBC says so of."""
        self.codec = codec
        own = set(codec.by_kind[PositionerStatus].dbc.senders)
        sent = [kind for kind, form in codec.by_kind.items() if own & set(form.dbc.senders)]
        self._outputs = {codec.identifier(kind) for kind in (*sent, CurrentCommand)}
        self._inputs = {codec.identifier(kind) for kind in INPUTS}
        self._command = codec.identifier(CurrentCommand)
        self._position = codec.identifier(StemPosition)
        self._setpoint = codec.identifier(Setpoint)

    def concerns(self, logged: LogFrame) -> bool:
        """Return whether the positioner hears or sends such a frame, or notes it."""
        is_note = logged.sent and _address(logged) == (NOTE_ID, True) and len(logged.frame.data) == _NOTE_BYTES
        return self.is_input(logged) or self.is_output(logged) or is_note

    def is_input(self, logged: LogFrame) -> bool:
        """Return whether the positioner hears such a frame; error frames reach everybody."""
        return logged.frame.is_error or _address(logged) in self._inputs

    def is_output(self, logged: LogFrame) -> bool:
        """Return whether a positioner sends such a frame."""
        return not logged.frame.is_error and _address(logged) in self._outputs

    def is_command(self, logged: LogFrame) -> bool:
        """Return whether it is a command, whoever sent it."""
        return not logged.frame.is_error and _address(logged) == self._command

    def is_position(self, logged: LogFrame) -> bool:
        """Return whether it is a position frame that can be read."""
        return _address(logged) == self._position and self._is_whole(logged)

    def is_setpoint(self, logged: LogFrame) -> bool:
        """Return whether it is a setpoint frame that can be read."""
        return _address(logged) == self._setpoint and self._is_whole(logged)

    def counter(self, logged: LogFrame) -> int | None:
        """Return the counter of a frame, intact or not, or None where it has none."""
        form = self.codec.by_id[_address(logged)]
        return self._raw(logged).get(form.counter) if form.counter else None

    def echo(self, logged: LogFrame, field: str) -> int | None:
        """Return the counter that a command echoes in `field`, or None where there is no such signal."""
        form = self.codec.by_kind[CurrentCommand]
        signal = next((each.signal for each in form.fields if each.name == field), None)
        return self._raw(logged).get(signal) if signal else None

    def _raw(self, logged: LogFrame) -> dict[str, Any]:
        form = self.codec.by_id[_address(logged)]
        if len(logged.frame.data) != form.dbc.length:
            return {}
        return form.dbc.decode(logged.frame.data, decode_choices=False, scaling=False)  # type: ignore[return-value]

    def _is_whole(self, logged: LogFrame) -> bool:
        try:
            self.codec.decode(logged.frame)
        except FrameRejectedError:
            return False
        return True


def command_echo(classifier: FrameClassifier, logged: LogFrame) -> int | None:
    """Return the position counter that a command echoes."""
    return classifier.echo(logged, "position_counter")


def _address(logged: LogFrame) -> tuple[int, bool]:
    return logged.frame.arbitration_id, logged.frame.is_extended
