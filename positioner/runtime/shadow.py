"""A second law beside the acting one on a live valve: its log, and its end where it fails. Shell.

`positioner.shadow` compares the two. Its cycle is computed after the frames of the acting law's cycle were sent. It
changes no command: an error in it ends the shadow with one line of the log, and so do cycles that are late again and
again, since the time of both laws is one.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from positioner.machine.journal import Throttle
from positioner.shadow.law import ShadowFailedError, ShadowLaw

if TYPE_CHECKING:
    from positioner.cycle.events import Event
    from positioner.cycle.input import CycleInput
    from positioner.cycle.state import CycleState, Setup
    from positioner.laws.law import Law
    from positioner.machine.journal import Log
    from positioner.machine.time import TimePort
    from positioner.shadow.differences import Differences

TOLD_EVERY_S = 10.0
"""Of setpoints that change more often than this the dwell with the largest difference is told, with their number."""

MOST_LATE = 10
"""Late cycles in a row: a machine that others use makes one late, or some; so many show that both laws do not fit."""


class Shadow:
    """The shadow of one valve's law; `setup` is that of the acting one. total: None before the first compared cycle."""

    def __init__(self, setup: Setup, law: Law[object], log: Log, time: TimePort) -> None:
        """Begin."""
        self._law, self._log = ShadowLaw(setup, law), log
        self._throttle = Throttle(TOLD_EVERY_S, time, log)
        self._is_dropped, self._late = False, 0
        log.info("shadow %s: runs beside %s, and sends nothing", law.name, setup.law.name)

    @property
    def total(self) -> Differences | None:
        """All that has been compared so far."""
        return self._law.total

    def cycle(self, cycle_input: CycleInput, before: CycleState, after: CycleState, events: tuple[Event, ...]) -> None:
        """Compare one cycle, which the acting law has ended `after` its frames were sent."""
        if self._is_dropped:
            return
        self._late = self._late + 1 if cycle_input.late_ns else 0
        if self._late >= MOST_LATE:
            self._drop(f"{MOST_LATE} cycles in a row were late, and both laws share their time")
            return
        try:
            if (dwell := self._law.cycle(cycle_input, before, after, events)) is not None:
                self._tell(dwell)
        except ShadowFailedError as error:
            self._drop(str(error))
        except Exception as error:  # noqa: BLE001 - a defect here must never end a control loop
            self._drop(f"{type(error).__name__}: {error}")

    def flush(self) -> None:
        """Log a dwell that was held back, once that is due."""
        self._throttle.flush()

    def close(self) -> None:
        """Log the last dwell, and all of them together."""
        if self._law.dwell is not None:
            self._tell(self._law.dwell)
        self._throttle.flush(all_of_them=True)
        if self._law.total is not None:
            self._log.info("shadow %s: in all: %s", self._law.name, self._law.total.in_words())

    def _tell(self, dwell: Differences) -> None:
        where = f"at {1e3 * dwell.setpoint_m:.3f} mm for {1e-9 * (dwell.ended_ns - dwell.begun_ns):.1f} s"
        line, size = f"shadow {self._law.name}: {where}: {dwell.in_words()}", abs(dwell.largest_ma)
        self._throttle.log(logging.INFO, "dwell", line, size=size)

    def _drop(self, why: str) -> None:
        self._is_dropped = True
        self._log.error("shadow %s: dropped, and the valve is controlled as before: %s", self._law.name, why)
