"""The daemon: the only loop. It moves frames between one bus and the session of one valve. Shell."""

from __future__ import annotations

import gc
import signal
from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.bus.port import BusPort, Ports
from positioner.cycle.step import IDLE_COMMAND_PERIOD_S
from positioner.errors import ExitCode
from positioner.machine.journal import logger
from positioner.runtime.announce import Announcer
from positioner.runtime.clock import Clock, RealClock
from positioner.runtime.lockstep import LockstepCheck, LockstepClock, LockstepGate
from positioner.runtime.other_controller import OtherController
from positioner.runtime.session import Session
from positioner.wire.messages import ActuatorState, CurrentCommand, ManualCurrent, Setpoint, StemPosition

if TYPE_CHECKING:
    from types import FrameType

    from positioner.config.schema import Configuration
    from positioner.runtime.session import RunOptions
    from positioner.wire.messages import CanFrame

_RECEIVED = (StemPosition, ActuatorState, Setpoint, ManualCurrent)
_IDLE_WAIT_S = 0.1
_SHORTEST_WAIT_S = 0.001
_NS = 1_000_000_000


class Daemon:
    """The loop: one bus, and the session of one valve."""

    def __init__(self, configuration: Configuration, options: RunOptions, ports: Ports | None = None) -> None:
        """Take the table over from the state directory.

        Raises:
            AlreadyRunningError: another process holds this valve's state.
            StateError: the state directory cannot be used.
            UsageError: the trace or the record cannot be written.
        """
        ports = ports or Ports()
        self._options = options
        self._stopping = False
        self.session = Session(configuration, options, ports.time)
        codec, self._period_s = self.session.setup.codec, self.session.setup.period_s
        self._announcer = Announcer(ports.time)
        # a dry run runs beside a controller: the commands of that controller are not foreign to it
        kinds = _RECEIVED if options.dry_run else (*_RECEIVED, CurrentCommand)
        identifiers = [codec.identifier(kind) for kind in kinds]
        self._bus = BusPort(configuration.bus, identifiers, self._announcer.bus, ports)
        self._clock: Clock = LockstepClock(codec, self._period_s) if options.lockstep else RealClock(ports.time)
        self._gate = LockstepGate(codec, options.setpoint_every)
        self._lockstep = LockstepCheck(codec)
        self._other = OtherController()

    def run(self) -> ExitCode:
        """Run until SIGTERM or SIGINT; return how it ended.

        Raises:
            AnotherControllerError: another controller goes on commanding this valve on the bus.
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
        """Receive, compute and send once; then report and keep the result. An empty cycle lets time pass."""
        frames = self._gate.admit(self._bus.receive(self._wait_s()))
        if self._bus.is_open:
            self._announcer.waiting(self._bus.address)
        now_ns = self._clock.now_ns(frames)
        if not self._clock.is_real:  # when a frame arrived means nothing to a virtual clock
            frames = tuple(replace(frame, received_ns=0) for frame in frames)
        cycle_input = self.session.input(frames, now_ns, self._late_ns())
        outbox, events = self.session.step(cycle_input)
        if not self._options.dry_run:
            self._send(outbox, now_ns)
        if self._options.lockstep:
            self._lockstep.add(frames, answered=bool(outbox))
        self._announcer.cycle(events)  # before `keep` may log that the table was replaced
        self.session.keep(cycle_input, outbox, events)
        self._other.check(events, now_ns, ever_armed=self.session.state.guard.arming.ever_armed)
        self._announcer.alive()

    def _wait_s(self) -> float:
        """Return the time in s to wait for a frame: nothing is due before it is over."""
        if not self.session.state.guard.arming.armed:
            return _IDLE_WAIT_S
        return max(min(self._period_s, IDLE_COMMAND_PERIOD_S), _SHORTEST_WAIT_S)

    def _late_ns(self) -> int:
        """Return for how long nobody read the bus, in ns; 0 where that is at most a period, and before arming."""
        gap_ns = self._bus.gap_ns
        late = self._clock.is_real and self.session.state.guard.arming.armed and gap_ns > self._period_s * _NS
        return gap_ns if late else 0

    def _send(self, outbox: tuple[CanFrame, ...], now_ns: int) -> None:
        """Send the frames, unless a stall in the middle of the cycle has made them too old meanwhile."""
        deadline_ns = self.session.deadline_ns(now_ns) if self._clock.is_real else None
        sent = [self._bus.send(frame, deadline_ns) for frame in outbox]
        if not all(sent[:1]):  # the command goes first
            self.session.unsent = True

    def _close(self) -> ExitCode:
        self._announcer.stopping()
        problem = self.session.close()
        self._bus.close()
        self._announcer.close()
        if problem:
            logger.error("%s", problem)
            return ExitCode.IO
        logger.info("stopped; the stiction table is saved")
        return ExitCode.OK

    def _stop(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._stopping = True
