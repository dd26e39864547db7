"""The session of one valve: its setup, state, stiction table, record and trace, from one turn to the next. Shell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, assert_never

from positioner.cycle.events import Event, Learned
from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState, Setup
from positioner.cycle.step import step
from positioner.errors import UsageError
from positioner.guard.supervisor import deadline_ns
from positioner.machine.journal import dropped_lines, logger
from positioner.runtime.record import BusRecorder
from positioner.runtime.trace import TraceWriter
from positioner.store.client import TableWriterClient
from positioner.store.messages import Notice, Replaced, Saved, SavingFailed, SavingWorks

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.config.schema import Configuration
    from positioner.guard.settings import GuardSettings
    from positioner.machine.time import TimePort
    from positioner.store.client import WriterEvent
    from positioner.valve.stiction import StictionTable
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

_CLOSE_TIMEOUT_S = 5.0
_POLL_EVERY_S = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """How a daemon runs, beside its configuration.

    setpoint_every: in lockstep, samples between two setpoint frames; 0 where the host keeps no such pace.
    """

    lockstep: bool = False
    setpoint_every: int = 0
    dry_run: bool = False
    trace: Path | None = None
    record: Path | None = None


class Session:
    """One valve: `turn` closes a cycle, `keep` looks after what was learned."""

    def __init__(
        self, configuration: Configuration, codec: Codec, limits: GuardSettings, options: RunOptions, time: TimePort
    ) -> None:
        """Take the table over from the state directory.

        Raises:
            AlreadyRunningError: another process holds this valve's state.
            StateError: the state directory cannot be used.
            UsageError: the trace or the record cannot be written.
        """
        self._time = time
        control = configuration.control
        self.table_writer, table, notices = TableWriterClient.open(
            configuration.state_directory, configuration.valve.id, control.table_cell_m, tell=logger.warning
        )
        for notice in notices:
            logger.warning("%s", notice)
        held = sum(len(cell.samples) for _, cell in table)
        logger.info("table of %s: %d samples in %d cells", configuration.valve.id, held, len(table))
        self.setup = Setup(
            codec,
            configuration.valve,
            limits,
            configuration.make_law(),
            control.sample_period_s,
            learns=not options.dry_run,
            limits=configuration.limits,
        )
        self.state = CycleState(table=table)
        try:
            self.trace = TraceWriter(options.trace) if options.trace else None
            self._recorder = BusRecorder(options.record)
        except OSError as error:
            self.table_writer.close(_CLOSE_TIMEOUT_S)
            what = "record" if error.filename == str(options.record) else "trace"
            raise UsageError(f"{what} {error.filename} cannot be written: {error.strerror}") from error
        self._cycle: tuple[CycleInput, tuple[CanFrame, ...]] | None = None
        self.unsent = False
        self._table_saved = True
        self._replaced: StictionTable | None = None
        self._lines_dropped = self._told_dropped = 0
        self._poll_due_s = 0.0

    def step(
        self, frames: tuple[CanFrame, ...], now_ns: int, late_ns: int
    ) -> tuple[tuple[CanFrame, ...], tuple[Event, ...]]:
        """Return the frames to send and the events of one cycle; nobody looked at the bus for `late_ns` before."""
        told = CycleInput(
            frames,
            now_ns,
            late_ns,
            self._lines_dropped - self._told_dropped,
            self._table_saved,
            self.unsent,
            self._replaced,
        )
        self._told_dropped, self.unsent, self._replaced = self._lines_dropped, False, None
        self.state, outbox, events = step(self.setup, self.state, told)
        self._cycle = told, outbox
        return outbox, events

    def record(self) -> None:
        """Record the turn, once its frames have left."""
        if self._cycle:
            self._recorder.cycle(*self._cycle, self.state.guard)

    def deadline_ns(self, now_ns: int) -> float | None:
        """Return the instant after which what the last cycle computed may not leave; None where nothing was."""
        return deadline_ns(self.setup.guard, self.state.guard, self.setup.period_s, now_ns)

    def keep(self, events: tuple[Event, ...]) -> None:
        """Hand over what was learned; take over what was reset or imported meanwhile."""
        self.table_writer.record([event.sample for event in events if isinstance(event, Learned)])
        if self._time.monotonic_s() < self._poll_due_s:
            return
        self._poll_due_s = self._time.monotonic_s() + _POLL_EVERY_S
        for heard in self.table_writer.poll():
            self._hear(heard)
        self._lines_dropped = dropped_lines()
        self._table_saved = self.table_writer.problem is None

    def _hear(self, heard: WriterEvent) -> None:
        match heard:
            case Replaced():
                self._replaced = heard.stored.table
                logger.info("the stiction table was replaced: %s", heard.reason)
            case SavingFailed():
                logger.error("%s", heard.reason)
            case SavingWorks():
                logger.info("the stiction table is saved again")
            case Notice():
                logger.warning("%s", heard)
            case Saved():
                pass
            case _:
                assert_never(heard)

    def close(self) -> str | None:
        """Save the table and end the record; return what went wrong with the table."""
        problem = self.table_writer.close(_CLOSE_TIMEOUT_S)
        self._recorder.close()
        return problem
