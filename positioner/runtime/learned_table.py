"""The stiction table of one valve in the daemon: saved by its table writer, replaced from outside. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING, assert_never

from positioner.machine.journal import logger
from positioner.store.client import TableWriterClient
from positioner.store.health_messages import HealthReplaced
from positioner.store.messages import Notice, Replaced, Saved, SavingFailed, SavingWorks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from positioner.config.schema import Configuration
    from positioner.machine.journal import Log
    from positioner.store.client import WriterEvent
    from positioner.valve.stiction import LearnedSample, StictionTable


class LearnedTable:
    """The table; `saved` while all of it is on the disk, as far as is known."""

    def __init__(self, configuration: Configuration, log: Log) -> None:
        """Take the table over from the state directory; `initial` is its content.

        Raises:
            AlreadyRunningError: another process holds this valve's state.
            StateError: the state directory cannot be used.
        """
        self._log = log
        self.writer, self.initial, notices = TableWriterClient.open(
            configuration.state_directory,
            configuration.valve.id,
            configuration.control.table_cell_m,
            report=log.warning,
        )
        for notice in notices:
            log.warning("%s", notice)
        held = sum(len(cell.samples) for _, cell in self.initial)
        logger.info("table of %s: %d samples in %d cells", configuration.valve.id, held, len(self.initial))
        self.saved = True
        self._replaced: StictionTable | None = None
        self.health = self.writer.health.found.sections
        self._replaced_health: HealthReplaced | None = None

    def take_replaced(self) -> StictionTable | None:
        """Return the table that somebody has put in the place of this one since the last call, if there is one."""
        replaced, self._replaced = self._replaced, None
        return replaced

    def take_replaced_health(self) -> HealthReplaced | None:
        """Return the health that somebody has reset since the last call, if somebody has."""
        replaced, self._replaced_health = self._replaced_health, None
        return replaced

    def record(self, samples: Sequence[LearnedSample]) -> None:
        """Hand the samples of a cycle to the table writer."""
        self.writer.record(samples)

    def poll(self) -> None:
        """Handle what the table writer reports."""
        for event in self.writer.poll():
            self._take(event)
        self.saved = self.writer.problem is None

    def _take(self, event: WriterEvent) -> None:
        match event:
            case Replaced():
                self._replaced = event.stored.table
                self._log.info("the stiction table was replaced: %s", event.reason)
            case HealthReplaced():
                self._replaced_health = event
                self._log.info("the counters of the valve begin anew: reset by command")
            case SavingFailed():
                self._log.error("%s", event.reason)
            case SavingWorks():
                self._log.info("the stiction table is saved again")
            case Notice():
                self._log.warning("%s", event.text)
            case Saved():
                pass
            case _:
                assert_never(event)

    def close(self, timeout_s: float) -> str | None:
        """Save the table; return the error, if there is one."""
        return self.writer.close(timeout_s)
