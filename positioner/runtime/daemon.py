"""The daemon: the only loop. It moves frames between the buses and the sessions of the valves. Shell."""

from __future__ import annotations

import gc
import logging
import signal
from typing import TYPE_CHECKING

from positioner.bus.buses import Buses
from positioner.bus.port import Ports
from positioner.errors import ExitCode, PositionerError
from positioner.machine.journal import Throttle, logger
from positioner.runtime.metrics import metrics_of
from positioner.runtime.service import Service
from positioner.runtime.session import close_sessions, open_sessions
from positioner.runtime.shared_bus import shared_buses

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import FrameType

    from positioner.bus.events import BusEvent
    from positioner.config.schema import Configuration
    from positioner.runtime.session import RunOptions, Session
    from positioner.wire.messages import CanFrame

STOPPED = "stopped; the stiction table is saved"
"""The last line of a daemon that has lost nothing."""


class Daemon:
    """The loop: one wait for the frames of every bus, and one session for each valve."""

    def __init__(
        self, configurations: Sequence[Configuration], options: RunOptions, ports: Ports | None = None
    ) -> None:
        """Take the tables over from the state directories.

        Raises:
            AlreadyRunningError: another process holds a valve's state.
            StateError: a state directory cannot be used.
            UsageError: a trace or a record cannot be written.
        """
        ports = ports or Ports()
        self._stopping = False
        self._time = ports.time
        self._throttle = Throttle(time=ports.time)
        self._service = Service(ports.time)
        self.sessions = open_sessions(configurations, options, ports.time)
        self._running = list(self.sessions)
        self._shared = shared_buses(configurations, self.sessions, self._report, ports)
        self._buses = Buses([bus.port for bus in self._shared], ports.time)
        self._metrics = metrics_of(configurations, self.sessions)

    def run(self) -> ExitCode:
        """Run until SIGTERM or SIGINT; return how it ended.

        Raises:
            AnotherControllerError: another controller goes on commanding the only valve on the bus.
        """
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._stop)
        gc.freeze()
        gc.disable()  # the cycle makes no reference cycles, and a collection would make a command late
        try:
            while not self._stopping:
                self._cycle()
        finally:
            code = self._close()
        return code

    def _cycle(self) -> None:
        """Receive once; then each valve has its cycle whose frames came, or whose time to wait is over."""
        due_s = min(session.due_s for session in self._running)
        batches = self._buses.receive(max(due_s - self._time.monotonic_s(), 0.0))
        if not self._service.ready:
            self._report_open_buses()
        for number, batch in batches:
            for session, frames in self._shared[number].by_valve(batch):
                self._run(session, frames)
        now_s = self._time.monotonic_s()
        waited_s = now_s if batches else max(now_s, due_s)
        for session in [session for session in self._running if session.due_s <= waited_s]:
            self._run(session, ())
        if self._service.alive():
            self._flush()
            for metrics in self._metrics:
                metrics.look(now_s)

    def _run(self, session: Session, frames: tuple[CanFrame, ...]) -> None:
        """Run one cycle of one valve. If it fails, the others go on; the only valve's error is the daemon's."""
        try:
            session.cycle(frames, self._buses.gap_ns)
        except PositionerError as error:
            if len(self._running) == 1:
                raise
            self._running.remove(session)
            session.end(error)
        except Exception as error:
            if len(self._running) == 1:
                raise
            session.start_again(error)
        if session.announcer.changed:
            self._report_states()

    def _report_open_buses(self) -> None:
        """Report each bus that was opened for the first time."""
        for bus in self._shared:
            if bus.announce_open():
                self._report_states()

    def _report_states(self) -> None:
        """Report the states of the valves to the service manager."""
        announcers = [session.announcer for session in self.sessions]
        self._service.state(announcers)
        for announcer in announcers:
            announcer.changed = False

    def _report(self, event: BusEvent) -> None:
        """Log an event of a bus."""
        self._throttle.log(logging.WARNING, f"{type(event).__name__} {event.address}", str(event))

    def _flush(self, *, all_of_them: bool = False) -> None:
        """Log the lines that were held back for their second."""
        for throttle in (self._throttle, *(session.announcer.throttle for session in self.sessions)):
            throttle.flush(all_of_them=all_of_them)

    def _close(self) -> ExitCode:
        self._service.stopping()
        problems = close_sessions(self.sessions)
        for bus in self._shared:
            bus.port.close()
        self._flush(all_of_them=True)
        self._service.close()
        for metrics in self._metrics:
            metrics.close()
        for session, problem in problems:
            session.announcer.log.error("%s", problem)
        if not problems:
            logger.info(STOPPED)
        return ExitCode.IO if problems else ExitCode.OK

    def _stop(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._stopping = True
