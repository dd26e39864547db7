"""The flight recorder: every frame that a positioner received and sent, cycle by cycle, as a candump log. Shell.

All frames of a cycle carry its instant, the very number in its `CycleInput`: those received as R, then those sent as T.
`positioner replay` can then do exactly what the positioner did. Notes before the cycle's frames hold the other fields
of the `CycleInput`. A note is a frame that no bus carried; all notes have one identifier of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.guard.state import GuardState
from positioner.machine.journal import Log, logger
from positioner.runtime.output_file import OutputFile

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from positioner.cycle.input import CycleInput
    from positioner.wire.messages import CanFrame

CHANNEL = "vcan0"
"""The bus's name in every log: canplayer plays the log there by default."""
NOTE_ID = 0x1FFFFFFF
"""Identifier (extended) of a note: the byte of its kind, and a number of seven bytes, low byte first."""
NOTED_FIELDS = ("table_saved", "late_ns", "lines_dropped", "unsent", "alarms")
"""Fields of a `CycleInput` that notes hold; the kind of such a note is the index here."""
KIND_AGE, KIND_CYCLE, KIND_TABLE = 0xFD, 0xFE, 0xFF
"""Other kinds of notes: for how many µs the frames after the note had waited; a cycle without frames in which the
guard's state changed; a cycle that was given another table."""
_ERROR_FRAME_ID = 0x20000080
_NS_PER_US = 1000


@dataclass(frozen=True, slots=True)
class Note:
    """What a cycle was given besides its frames: the kind (an index of `NOTED_FIELDS`, or a `KIND_`) and the value."""

    kind: int
    value: int = 0

    @property
    def data(self) -> bytes:
        """The eight bytes of the note."""
        return bytes((self.kind,)) + self.value.to_bytes(7, "little")

    @classmethod
    def of(cls, data: bytes) -> Note:
        """Return the note in `data`."""
        return cls(data[0], int.from_bytes(data[1:], "little"))


class BusRecorder:
    """Writes the log."""

    def __init__(self, path: Path | None, log: Log = logger) -> None:
        """Create `path`; without one nothing is ever written.

        Raises:
            UsageError: it cannot be written.
        """
        self._file = OutputFile("record", path, log)
        self.close = self._file.close
        self._guard = GuardState()
        self._table_saved, self._alarms = True, 0

    def cycle(self, cycle_input: CycleInput, outbox: Sequence[CanFrame], guard: GuardState) -> None:
        """Append one cycle: its input, its frames to send, and the guard after it."""
        if not self._file.is_open:
            return
        notes = self._notes(cycle_input)
        if not cycle_input.frames and not outbox and _moved(self._guard, guard):
            notes.append(Note(KIND_CYCLE))
        self._guard, self._table_saved, self._alarms = guard, cycle_input.table_saved, cycle_input.alarms
        where = f"({_instant(cycle_input.now_ns)}) {CHANNEL}"
        lines = [_note_line(where, note) for note in notes]
        lines += _received(cycle_input.frames, cycle_input.now_ns, where)
        lines += [f"{where} {_text(frame)} T\n" for frame in outbox]
        self._file.write("".join(lines))

    def _notes(self, cycle_input: CycleInput) -> list[Note]:
        """Return a note for each field that is not as usual; table, alarms: usual while they stay the same."""
        usual = (self._table_saved, 0, 0, False, self._alarms)
        values = [getattr(cycle_input, name) for name in NOTED_FIELDS]
        notes = [Note(kind, int(value)) for kind, value in enumerate(values) if value != usual[kind]]
        return notes if cycle_input.table is None else [*notes, Note(KIND_TABLE)]


def _received(inbox: Sequence[CanFrame], now_ns: int, where: str) -> list[str]:
    """Return the lines of the frames, with a note wherever the time for which they had waited changes."""
    lines, age_us = [], 0
    for frame in inbox:
        waited_us = (now_ns - frame.received_ns) // _NS_PER_US if frame.received_ns else 0
        if waited_us != age_us:
            age_us = waited_us
            lines.append(_note_line(where, Note(KIND_AGE, age_us)))
        lines.append(f"{where} {_text(frame)} R\n")
    return lines


def _note_line(where: str, note: Note) -> str:
    return f"{where} {NOTE_ID:08X}#{note.data.hex().upper()} T\n"


def _moved(before: GuardState, after: GuardState) -> bool:
    return (before.mode, before.cause, before.law.late_cycles) != (after.mode, after.cause, after.law.late_cycles)


def _instant(now_ns: int) -> str:
    """Return `now_ns` in seconds with six decimals, or nine where microseconds do not hold it."""
    seconds, rest_ns = divmod(now_ns, 1_000_000_000)
    return f"{seconds}.{rest_ns:09d}" if rest_ns % _NS_PER_US else f"{seconds}.{rest_ns // _NS_PER_US:06d}"


def _text(frame: CanFrame) -> str:
    if frame.is_error:
        return f"{_ERROR_FRAME_ID:08X}#{bytes(8).hex()}"
    identifier = f"{frame.arbitration_id:08X}" if frame.is_extended else f"{frame.arbitration_id:03X}"
    return f"{identifier}#R" if frame.is_remote else f"{identifier}#{frame.data.hex().upper()}"
