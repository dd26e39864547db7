"""The session of one valve: its setup, state, stiction table, record and trace, from one cycle to the next. Shell."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, assert_never

from positioner.cycle.events import Event, Learned
from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState
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
    from positioner.machine.time import TimePort
    from positioner.store.client import WriterEvent
    from positioner.valve.stiction import StictionTable
    from positioner.wire.messages import CanFrame

_CLOSE_TIMEOUT_S = 5.0
_POLL_EVERY_S = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """How a daemon runs, besides its configuration.

    setpoint_every: in lockstep, samples between two setpoint frames; 0 where the host keeps no such pace.
    dry_run: beside another controller; the daemon arms by itself, sends nothing and learns nothing.
    """

    lockstep: bool = False
    setpoint_every: int = 0
    dry_run: bool = False
    trace: Path | None = None
    record: Path | None = None


class Session:
    """One valve. In each cycle: `input` gathers its input, `step` computes it, `keep` stores its result.

    unsent: the bus did not take the last command.
    """

    def __init__(self, configuration: Configuration, options: RunOptions, time: TimePort) -> None:
        """Take the table over from the state directory.

        Raises:
            AlreadyRunningError: another process holds this valve's state.
            StateError: the state directory cannot be used.
            UsageError: the trace or the record cannot be written.
        """
        self._time = time
        self.table_writer, table, notices = TableWriterClient.open(
            configuration.state_directory,
            configuration.valve.id,
            configuration.control.table_cell_m,
            report=logger.warning,
        )
        for notice in notices:
            logger.warning("%s", notice)
        held = sum(len(cell.samples) for _, cell in table)
        logger.info("table of %s: %d samples in %d cells", configuration.valve.id, held, len(table))
        self.setup = configuration.make_setup()
        if options.dry_run:
            self.setup = replace(self.setup, guard=replace(configuration.guard, auto_arm=True), learns=False)
        self.state = CycleState(table=table)
        try:
            self._trace = TraceWriter(options.trace)
            self._recorder = BusRecorder(options.record)
        except UsageError:
            self.table_writer.close(_CLOSE_TIMEOUT_S)
            raise
        self.unsent = False
        self._table_saved = True
        self._replaced: StictionTable | None = None
        self._lines_dropped = self._reported_dropped = 0
        self._poll_due_s = 0.0

    def input(self, frames: tuple[CanFrame, ...], now_ns: int, late_ns: int) -> CycleInput:
        """Return the input of the next cycle; nobody read the bus for `late_ns` before."""
        cycle_input = CycleInput(
            frames,
            now_ns,
            late_ns=late_ns,
            lines_dropped=self._lines_dropped - self._reported_dropped,
            table_saved=self._table_saved,
            unsent=self.unsent,
            table=self._replaced,
        )
        self._reported_dropped, self.unsent, self._replaced = self._lines_dropped, False, None
        return cycle_input

    def step(self, cycle_input: CycleInput) -> tuple[tuple[CanFrame, ...], tuple[Event, ...]]:
        """Return the frames to send and the events of one cycle."""
        self.state, outbox, events = step(self.setup, self.state, cycle_input)
        return outbox, events

    def deadline_ns(self, now_ns: int) -> float | None:
        """Return the instant after which the last cycle's frames may not be sent any more; None without a deadline."""
        return deadline_ns(self.setup.guard, self.state.guard, self.setup.period_s, now_ns)

    def keep(self, cycle_input: CycleInput, outbox: tuple[CanFrame, ...], events: tuple[Event, ...]) -> None:
        """Record the cycle, hand its samples to the table writer, and handle the events of the table writer."""
        self._recorder.cycle(cycle_input, outbox, self.state.guard)
        self._trace.cycle(events)
        self.table_writer.record([event.sample for event in events if isinstance(event, Learned)])
        if self._time.monotonic_s() < self._poll_due_s:
            return
        self._poll_due_s = self._time.monotonic_s() + _POLL_EVERY_S
        for event in self.table_writer.poll():
            self._take(event)
        self._lines_dropped = dropped_lines()
        self._table_saved = self.table_writer.problem is None

    def _take(self, event: WriterEvent) -> None:
        match event:
            case Replaced():
                self._replaced = event.stored.table
                logger.info("the stiction table was replaced: %s", event.reason)
            case SavingFailed():
                logger.error("%s", event.reason)
            case SavingWorks():
                logger.info("the stiction table is saved again")
            case Notice():
                logger.warning("%s", event.text)
            case Saved():
                pass
            case _:
                assert_never(event)

    def close(self) -> str | None:
        """Save the table and end record and trace; return the error of the table, if there is one."""
        problem = self.table_writer.close(_CLOSE_TIMEOUT_S)
        self._recorder.close()
        self._trace.close()
        return problem
