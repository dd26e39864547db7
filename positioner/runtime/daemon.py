"""The daemon: the only loop. It moves frames between the bus and `cycle.step`, and tells everybody else. Shell."""

from __future__ import annotations

import gc
import logging
import signal
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, assert_never

from positioner.bus.port import BusPort
from positioner.bus.ports import Ports
from positioner.cycle.events import Event, Learned
from positioner.cycle.state import CycleState, Setup
from positioner.cycle.step import IDLE_COMMAND_PERIOD_S, step
from positioner.errors import ExitCode, UsageError
from positioner.guard import supervisor as guard
from positioner.machine.journal import dropped_lines, logger
from positioner.runtime.announce import Announcer
from positioner.runtime.clock import Clock, LockstepClock, LockstepGate, RealClock
from positioner.runtime.lockstep_watch import LockstepWatch
from positioner.runtime.record import BusRecorder
from positioner.runtime.trace import TraceWriter
from positioner.store.client import TableKeeper
from positioner.store.messages import Notice, Replaced, Saved, SavingFailed, SavingWorks
from positioner.wire.messages import ActuatorState, CurrentCommand, ManualCurrent, Setpoint, StemPosition

if TYPE_CHECKING:
    from pathlib import Path
    from types import FrameType

    from positioner.config.configuration import Configuration
    from positioner.store.client import KeeperEvent
    from positioner.wire.messages import CanFrame

_WATCHED = (StemPosition, ActuatorState, Setpoint, ManualCurrent)
_IDLE_WAIT_S = 0.1
_SHORTEST_WAIT_S = 0.001
_CLOSE_TIMEOUT_S = 5.0
_WATCHDOG_EVERY_S = 0.1
_POLL_EVERY_S = 0.02
_NS = 1_000_000_000


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


class Daemon:
    """One valve, one bus, one loop."""

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
        control = configuration.control
        self._keeper, table, notices = TableKeeper.open(
            configuration.state_directory, configuration.valve.id, control.table_cell_m, tell=logger.warning
        )
        for notice in notices:
            logger.warning("%s", notice)
        held = sum(len(cell.samples) for _, cell in table)
        logger.info("table of %s: %d samples in %d cells", configuration.valve.id, held, len(table))
        self._period_s = control.sample_period_s
        # a dry run watches beside whoever controls the valve: it arms by itself and hears no commands
        kinds = _WATCHED if options.dry_run else (*_WATCHED, CurrentCommand)
        limits = replace(configuration.guard, auto_arm=True) if options.dry_run else configuration.guard
        self._bus = BusPort(configuration.bus, [codec.identifier(kind) for kind in kinds], self._report, ports)
        self._lockstep = LockstepWatch(codec)
        self._gate = LockstepGate(codec, options.setpoint_every)
        self._clock: Clock = LockstepClock(codec, self._period_s) if options.lockstep else RealClock(self._time)
        self._setup = Setup(
            codec,
            configuration.valve,
            limits,
            configuration.make_law(),
            self._period_s,
            learns=not options.dry_run,
            limits=configuration.limits,
        )
        self._state = CycleState(table=table)
        try:
            self._announcer.trace = TraceWriter(options.trace) if options.trace else None
            self._recorder = BusRecorder(options.record)
        except OSError as error:
            self._keeper.close(_CLOSE_TIMEOUT_S)
            what = "record" if error.filename == str(options.record) else "trace"
            raise UsageError(f"{what} {error.filename} cannot be written: {error.strerror}") from error
        self._watchdog_due_s = 0.0
        self._poll_due_s = 0.0
        self._dropped = 0

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
                self._turn()
        finally:
            code = self._close()
        return code

    def _turn(self) -> None:
        """Close one cycle, or let time pass."""
        frames = self._bus.receive(self._wait_s())
        if self._bus.is_open and not self._announcer.ready:
            self._announcer.notifier.send(STATUS=f"waiting for position frames on {self._bus.address}")
        frames = self._gate.admit(frames)
        now_ns = self._clock.now_ns(frames)
        told, frames = self._timed(frames)
        left, outbox, events = step(self._setup, told, frames, now_ns)
        self._state = left
        if not self._options.dry_run:
            self._send(outbox, now_ns)
        if self._options.lockstep:
            self._lockstep.turn(frames, answered=bool(outbox))
        self._recorder.turn(told, frames, now_ns, outbox, left)
        self._announcer.tell(events, now_ns, ever_armed=self._state.guard.ever_armed)
        self._keep(events)
        if self._time.monotonic_s() >= self._watchdog_due_s:  # whoever waits for feedback or for arming is alive, too
            self._watchdog_due_s = self._time.monotonic_s() + _WATCHDOG_EVERY_S
            self._announcer.alive()

    def _wait_s(self) -> float:
        """Return how long to wait for a frame: for as long as nothing is due."""
        if not self._state.guard.armed:
            return _IDLE_WAIT_S
        return max(min(self._period_s, IDLE_COMMAND_PERIOD_S), _SHORTEST_WAIT_S)

    def _timed(self, frames: tuple[CanFrame, ...]) -> tuple[CycleState, tuple[CanFrame, ...]]:
        """Return what the cycle is told: frames with their arrival, and how long nobody looked if that was too long."""
        if not self._clock.is_real:
            return self._state, tuple(replace(frame, received_ns=0) for frame in frames)
        gap_ns = self._bus.gap_ns
        late = self._state.guard.armed and gap_ns > self._period_s * _NS  # before, nothing is due
        return replace(self._state, late_ns=gap_ns) if late else self._state, frames

    def _send(self, outbox: tuple[CanFrame, ...], now_ns: int) -> None:
        """Send, but nothing that a stall in the middle of the turn has made too old meanwhile."""
        setup, watch = self._setup, self._state.guard
        deadline_ns = guard.deadline_ns(setup.guard, watch, setup.period_s, now_ns) if self._clock.is_real else None
        sent = [self._bus.send(frame, deadline_ns) for frame in outbox]
        if not all(sent[:1]):  # the command goes first
            self._state = replace(self._state, unsent=True)

    def _keep(self, events: tuple[Event, ...]) -> None:
        """Hand over what was learned; take over what was reset or imported meanwhile."""
        samples = [event.sample for event in events if isinstance(event, Learned)]
        self._keeper.record(samples)
        if self._time.monotonic_s() < self._poll_due_s:
            return
        self._poll_due_s = self._time.monotonic_s() + _POLL_EVERY_S
        for heard in self._keeper.poll():
            self._hear(heard)
        if (dropped := dropped_lines()) != self._dropped:
            self._state = replace(self._state, lines_dropped=dropped - self._dropped)
            self._dropped = dropped
        saved = self._keeper.problem is None
        if saved is not self._state.table_saved:
            self._state = replace(self._state, table_saved=saved)

    def _hear(self, heard: KeeperEvent) -> None:
        match heard:
            case Replaced():
                self._state = replace(self._state, table=heard.stored.table)
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

    def _close(self) -> ExitCode:
        self._announcer.notifier.send(STOPPING="1")
        problem = self._keeper.close(_CLOSE_TIMEOUT_S)
        self._announcer.end_trace()
        self._announcer.throttle.flush(all_of_them=True)
        self._recorder.close()
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

    def _report(self, line: str) -> None:
        # told apart by what happened, not by the bus that all lines name first
        self._announcer.throttle.log(logging.WARNING, line.replace(str(self._bus.address), "")[:16], line)
