"""The preparation of a replay: the log, its cycles, and the table at its start. Shell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tqdm import tqdm

from positioner.errors import StateError
from positioner.inputs.plain_file import MOST_MIB
from positioner.replay.cycles import cycles_of
from positioner.replay.log import BusLog, LogError, LogFrame, read_log
from positioner.replay.recorded import FrameClassifier, RecordedCycle
from positioner.replay.survey import LogKind, Survey
from positioner.runtime.record import KIND_TABLE, Note
from positioner.store import access
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from positioner.config.schema import Configuration


@dataclass(frozen=True, slots=True)
class PreparedLog:
    """A log that is ready to be replayed; its frames stay in the file."""

    log: BusLog
    classifier: FrameClassifier
    period_ns: int
    kind: LogKind
    cycle_count: int
    readings: int
    commands: int
    table: StictionTable
    warnings: tuple[str, ...]
    late: str = ""
    """How the log shows that it begins after the positioner's start; empty if it begins in time."""

    def cycles(self) -> Iterator[RecordedCycle]:
        """Yield the cycles, read from the file anew."""
        return cycles_of(self.kind, self.classifier, self.log.frames(), self.period_ns)


def prepare(path: Path, configuration: Configuration, state: Path | None, most_mib: int = MOST_MIB) -> PreparedLog:
    """Return the log in `path`, ready to be replayed, starting from the table in `state`, which is only read.

    most_mib: see `read_log`.

    Raises:
        LogError: the log cannot be read, or holds no position frame of this valve.
        StateError: the table cannot be read, or belongs to another valve.
    """
    classifier = FrameClassifier(configuration.make_codec())
    period_ns = round(configuration.control.sample_period_s * 1e9)
    survey = Survey(classifier, period_ns)
    log = read_log(path, survey.add, most_mib)
    if not survey.readings:
        raise LogError(
            f"{path}: holds {log.count} frames, and no position frame among them: is it another valve's, or does "
            "[wire] describe other frames?"
        )
    table = _table(configuration, state, int(log.begin_s))
    cycle_count = commands = 0
    first: LogFrame | None = None
    replaced: LogFrame | None = None
    cycles = cycles_of(survey.kind, classifier, log.frames(), period_ns)
    for cycle in tqdm(cycles, "sorting", unit=" cycles", delay=1.0, leave=False, disable=None):
        cycle_count += 1
        for frame in cycle.outbox:
            if classifier.is_command(frame):
                commands += 1
                first = first or frame
        replaced = replaced or next((frame for frame in cycle.notes if _is_of_a_table(frame)), None)
    late = _late(classifier, survey, first) if first else ""
    warnings = [f"starts late: {late}"] if late else []
    if replaced:
        text = f"the stiction table was replaced at {log.instant_s(replaced):.6f} s"
        warnings.insert(0, f"{text}, and the log does not hold the new one: differences may follow")
    return PreparedLog(
        log, classifier, period_ns, survey.kind, cycle_count, survey.readings, commands, table, tuple(warnings), late
    )


def _late(classifier: FrameClassifier, survey: Survey, command: LogFrame) -> str:
    """Return how the log shows that earlier frames of the positioner are missing, empty if none are.

    The counters of a positioner begin with 0.
    """
    if survey.first_reading and command.number < survey.first_reading.number:
        return f"a command, frame {command.number}, comes before the first position frame"
    for first in (command, survey.first_other):
        if first is not None and (counter := classifier.counter(first)):
            return f"frame {first.number} has the counter {counter}, and a positioner begins with 0"
    return ""


def _is_of_a_table(note: LogFrame) -> bool:
    return Note.of(note.frame.data).kind == KIND_TABLE


def _table(configuration: Configuration, state: Path | None, now_s: int) -> StictionTable:
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
    return stored.table_at(now_s)
