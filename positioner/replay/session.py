"""What a replay starts from: the log, its turns, the configuration and the table. Shell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.errors import StateError
from positioner.record import KIND_TABLE, Note
from positioner.replay.log import BusLog, LogError, LogFrame, read_log
from positioner.replay.recorded import Heard, Turn
from positioner.replay.turns import LogKind, turns_of
from positioner.stiction import StictionTable
from positioner.store import access

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from positioner.config import Configuration


@dataclass(frozen=True, slots=True)
class Session:
    """A log that is ready to be done again."""

    log: BusLog
    kind: LogKind
    turns: tuple[Turn, ...]
    readings: int
    commands: int
    table: StictionTable
    warnings: tuple[str, ...]
    late: str = ""
    """How the log shows that the positioner had been at work before it; empty where it begins in time."""


def prepare(path: Path, configuration: Configuration, state: Path | None) -> Session:
    """Return the session of the log in `path`, starting from the table in `state`, which is only read.

    Raises:
        LogError: the log cannot be read, or holds no position frame of this valve.
        StateError: the table cannot be read, or is another valve's.
    """
    log = read_log(path)
    codec = configuration.make_codec()
    heard = Heard(codec)
    readings = sum(heard.is_position(frame) for frame in log.frames)
    if not readings:
        raise LogError(
            f"{path}: holds {len(log.frames)} frames, and no position frame among them: is it another valve's, or does "
            "[wire] describe other frames?"
        )
    kind, turns = turns_of(codec, log.frames, configuration.control.sample_period_s)
    commands = sum(heard.is_command(frame) for turn in turns for frame in turn.recorded)
    late = _late(heard, turns, log.frames)
    warnings = (*_warnings(turns, log), *((f"starts late: {late}",) if late else ()))
    return Session(log, kind, turns, readings, commands, _table(configuration, state), warnings, late)


def _late(heard: Heard, turns: tuple[Turn, ...], frames: Sequence[LogFrame]) -> str:
    """Return how the frames tell that the positioner had spoken before them; its counters begin at 0."""
    command = next((frame for turn in turns for frame in turn.recorded if heard.is_command(frame)), None)
    if command is None:
        return ""
    if command.number < next(frame.number for frame in frames if heard.is_position(frame)):
        return f"a command, frame {command.number}, stands before the first position frame"
    others = (frame for frame in frames if heard.is_output(frame) and not heard.is_command(frame))
    for first in (command, next(others, None)):
        if first is not None and (counter := heard.counter(first)):
            return f"frame {first.number} has the counter {counter}, and a positioner begins with 0"
    return ""


def _table(configuration: Configuration, state: Path | None) -> StictionTable:
    cell_m = configuration.control.table_cell_m
    if state is None:
        return StictionTable(cell_width_m=cell_m)
    stored = access.dump(state)
    if stored.valve_id != configuration.valve.id:
        raise StateError(f"{state}: the table belongs to {stored.valve_id!r}, the configuration is of another valve")
    if stored.table.cell_width_m != cell_m:
        raise StateError(
            f"{state}: the table has cells of {stored.table.cell_width_m:g} m, the configuration {cell_m:g} m"
        )
    return stored.table


def _warnings(turns: tuple[Turn, ...], log: BusLog) -> tuple[str, ...]:
    replaced = [frame for turn in turns for frame in turn.notes if Note.of(frame.frame.data).kind == KIND_TABLE]
    if not replaced:
        return ()
    when = log.instant_s(replaced[0])
    return (
        f"the stiction table was replaced at {when:.6f} s, and the log cannot tell by what: differences may follow",
    )
