"""The daemon: the only loop. It moves frames between the bus and a valve's session, and tells everybody else. Shell."""

from __future__ import annotations

import gc
import logging
import signal
from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.bus.port import BusPort
from positioner.bus.ports import Ports
from positioner.cycle.step import IDLE_COMMAND_PERIOD_S
from positioner.errors import ExitCode
from positioner.machine.journal import logger
from positioner.runtime.announce import Announcer
from positioner.runtime.clock import Clock, LockstepClock, LockstepGate, RealClock
from positioner.runtime.lockstep_watch import LockstepWatch
from positioner.runtime.session import Session
from positioner.wire.messages import ActuatorState, CurrentCommand, ManualCurrent, Setpoint, StemPosition

if TYPE_CHECKING:
    from types import FrameType

    from positioner.bus.events import BusEvent
    from positioner.config.schema import Configuration
    from positioner.runtime.session import RunOptions
    from positioner.wire.messages import CanFrame

_WATCHED = (StemPosition, ActuatorState, Setpoint, ManualCurrent)
_IDLE_WAIT_S = 0.1
_SHORTEST_WAIT_S = 0.001
_WATCHDOG_EVERY_S = 0.1
_NS = 1_000_000_000


class Daemon:
    """The loop: one bus, and the session of one valve."""

    def __init__(self, configuration: Configuration, options: RunOptions, ports: Ports | None = None) -> None:
        """Take the table over from the state directory.

        Raises:
            AlreadyRunningError: another process holds this valve's state.
            StateError: the state directory cannot be used.
            UsageError: the trace cannot be written.
        """
        self._options = options
        ports = ports or Ports()
        self._time = ports.time
        self._announcer = Announcer(self._time)
        self._stopping = False
        codec = configuration.make_codec()
        self._period_s = configuration.control.sample_period_s
        # a dry run watches beside whoever controls the valve: it arms by itself and hears no commands
        kinds = _WATCHED if options.dry_run else (*_WATCHED, CurrentCommand)
        limits = replace(configuration.guard, auto_arm=True) if options.dry_run else configuration.guard
        self.session = Session(configuration, codec, limits, options, self._time)
        self._announcer.trace = self.session.trace
        self._bus = BusPort(configuration.bus, [codec.identifier(kind) for kind in kinds], self._report, ports)
        self._lockstep = LockstepWatch(codec)
        self._gate = LockstepGate(codec, options.setpoint_every)
        self._clock: Clock = LockstepClock(codec, self._period_s) if options.lockstep else RealClock(self._time)
        self._watchdog_due_s = 0.0

    def run(self) -> ExitCode:
        """Run until SIGTERM or SIGINT; return how it ended.

        Raises:
            AnotherControllerError: another controller goes on commanding this valve on the bus.
        """
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._stop)
        gc.freeze()
        gc.disable()  # the cycle makes no reference cycles, and a collection would be a late command
        try:
            while not self._stopping:
                self._cycle()
        finally:
            code = self._close()
        return code

    def _cycle(self) -> None:
        """Close one cycle, or let time pass."""
        frames = self._bus.receive(self._wait_s())
        if self._bus.is_open and not self._announcer.ready:
            self._announcer.notifier.send(STATUS=f"waiting for position frames on {self._bus.address}")
        frames = self._gate.admit(frames)
        now_ns = self._clock.now_ns(frames)
        late_ns, frames = self._timed(frames)
        outbox, events = self.session.step(frames, now_ns, late_ns)
        if not self._options.dry_run:
            self._send(outbox, now_ns)
        if self._options.lockstep:
            self._lockstep.count(frames, answered=bool(outbox))
        self.session.record()
        self._announcer.tell(events, now_ns, ever_armed=self.session.state.guard.ever_armed)
        self.session.keep(events)
        if self._time.monotonic_s() >= self._watchdog_due_s:  # whoever waits for feedback or for arming is alive, too
            self._watchdog_due_s = self._time.monotonic_s() + _WATCHDOG_EVERY_S
            self._announcer.alive()

    def _wait_s(self) -> float:
        """Return how long to wait for a frame: for as long as nothing is due."""
        if not self.session.state.guard.armed:
            return _IDLE_WAIT_S
        return max(min(self._period_s, IDLE_COMMAND_PERIOD_S), _SHORTEST_WAIT_S)

    def _timed(self, frames: tuple[CanFrame, ...]) -> tuple[int, tuple[CanFrame, ...]]:
        """Return how long nobody looked, if that was too long, and the frames with their arrival."""
        if not self._clock.is_real:
            return 0, tuple(replace(frame, received_ns=0) for frame in frames)
        gap_ns = self._bus.gap_ns
        late = self.session.state.guard.armed and gap_ns > self._period_s * _NS  # before, nothing is due
        return gap_ns if late else 0, frames

    def _send(self, outbox: tuple[CanFrame, ...], now_ns: int) -> None:
        """Send, but nothing that a stall in the middle of the turn has made too old meanwhile."""
        deadline_ns = self.session.deadline_ns(now_ns) if self._clock.is_real else None
        sent = [self._bus.send(frame, deadline_ns) for frame in outbox]
        if not all(sent[:1]):  # the command goes first
            self.session.unsent = True

    def _close(self) -> ExitCode:
        self._announcer.notifier.send(STOPPING="1")
        problem = self.session.close()
        self._announcer.end_trace()
        self._announcer.throttle.flush(all_of_them=True)
        self._bus.close()
        self._announcer.notifier.close()
        if problem:
            logger.error("%s", problem)
            return ExitCode.IO
        logger.info("stopped; the stiction table is saved")
        return ExitCode.OK

    def _stop(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._stopping = True

    def _report(self, event: BusEvent) -> None:
        self._announcer.throttle.log(logging.WARNING, type(event).__name__, str(event))
