"""The health of one valve in the daemon: computed after each cycle has sent its frames, handed over to be kept. Shell.

It changes no command: an error in it ends the counting with one line of the log, and the valve is controlled as before.
"""

from __future__ import annotations

import logging
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from positioner.health.alarm_text import change_in_words
from positioner.health.alarms import acknowledged, dated, packed_alarms
from positioner.health.counters_document import COUNTERS
from positioner.health.monitor import begin_health, observe_step, sections_of
from positioner.health.trends_document import TRENDS, trends_from
from positioner.runtime.health_reference import measured_health_settings
from positioner.values import replace

if TYPE_CHECKING:
    from positioner.config.schema import Configuration
    from positioner.cycle.events import Event
    from positioner.cycle.input import CycleInput
    from positioner.cycle.state import CycleState
    from positioner.health.monitor import HealthState
    from positioner.health.watch import Watch
    from positioner.machine.journal import Log
    from positioner.runtime.learned_table import LearnedTable
    from positioner.wire.messages import CanFrame

HAND_OVER_NS = 5_000_000_000
"""A daemon that is killed has counted so much that nobody keeps, at most."""


class ValveHealth:
    """The health of the valve; `state` is it after the last cycle, None where an error has ended it.

    alarms: those of the valve's condition, as a cycle is given them.
    """

    def __init__(self, configuration: Configuration, table: LearnedTable, log: Log, *, testing: bool = False) -> None:
        """Go on from the health that was kept; `testing`: a test procedure is in the place of the law."""
        settings = measured_health_settings(configuration, log.warning, aside=True)
        counters, watch = replace(settings.counters, testing=testing), replace(settings.watch, testing=testing)
        self._settings = replace(settings, counters=counters, watch=watch)
        self._table, self._log = table, log
        self._due_ns: int | None = None
        self.state: HealthState | None = self._begun(table.health)
        self.alarms = packed_alarms(self.state.watch.trends.alarms) if self.state else 0

    def cycle(
        self,
        cycle_input: CycleInput,
        before: CycleState,
        after: CycleState,
        outbox: tuple[CanFrame, ...],
        events: tuple[Event, ...],
    ) -> None:
        """Add one cycle."""
        if self.state is None:
            return
        try:
            if observe_step(self._settings, self.state, cycle_input, before, after, outbox, events):
                self._look(self.state.watch, cycle_input.now_ns)
        except Exception as error:  # noqa: BLE001 - a defect here must never end a control loop
            self._log.error("health: not counted any more: %s: %s", type(error).__name__, error)
            self.state, self.alarms = None, 0

    def _look(self, watch: Watch, now_ns: int) -> None:
        """Tell which alarms changed, and hand over when that is due."""
        if watch.changed:
            self._tell(watch)
        if self._due_ns is None or now_ns >= self._due_ns:
            self._due_ns = now_ns + HAND_OVER_NS
            self.hand_over()
        self.alarms = 0 if self.state is None else packed_alarms(self.state.watch.trends.alarms)

    def _tell(self, watch: Watch) -> None:
        """Log the alarms that came or went, and date those that came."""
        date = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        watch.trends = replace(watch.trends, alarms=dated(watch.trends.alarms, date))
        for change in watch.changed:
            level = logging.WARNING if change.came else logging.INFO
            self._log.log(level, "%s", change_in_words(change))

    def hand_over(self) -> None:
        """Hand the health over to the table writer, or take over what a command has changed."""
        if (replaced := self._table.take_replaced_health()) is not None:
            self._take(replaced.sections)
        elif self.state is not None:
            self._table.writer.keep_health(sections_of(self.state))

    def _take(self, sections: dict[str, object]) -> None:
        """Go on from what a reset has left; with the counters in place somebody has acknowledged alarms."""
        if COUNTERS not in sections or self.state is None:
            self.state = self._begun(sections)
            return
        given = trends_from(sections.get(TRENDS), self._settings.watch.reference)
        watch, seen = self.state.watch, [alarm.cause for alarm in given.alarms if alarm.acknowledged]
        watch.trends = replace(watch.trends, alarms=acknowledged(watch.trends.alarms, seen))

    def _begun(self, sections: dict[str, object]) -> HealthState:
        """Return the health as it is kept, else a new one."""
        try:
            return begin_health(self._settings, sections)
        except (ValueError, KeyError, TypeError) as error:
            self._log.warning("the health that was kept cannot be used: %s; it begins anew", error)
            return begin_health(self._settings, {})
