"""The session of one valve: setup, state, clock, log, table, record and trace, from one cycle to the next. Shell."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from positioner.commissioning.procedure import commissioning_setup, procedure_law
from positioner.cycle.events import Learned
from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState
from positioner.cycle.step import IDLE_COMMAND_PERIOD_S, step
from positioner.guard.supervisor import deadline_ns
from positioner.machine.journal import dropped_lines
from positioner.machine.time import MachineTime, TimePort
from positioner.runtime.announce import Announcer
from positioner.runtime.clock import Clock, RealClock
from positioner.runtime.learned_table import LearnedTable
from positioner.runtime.lockstep import LockstepCheck, LockstepClock, LockstepGate
from positioner.runtime.other_controller import OtherController
from positioner.runtime.record import BusRecorder
from positioner.runtime.shadow import Shadow
from positioner.runtime.trace import TraceWriter
from positioner.runtime.valve_health import ValveHealth
from positioner.start import unexpected
from positioner.wire.messages import ActuatorState, CurrentCommand, ManualCurrent, Setpoint, StemPosition

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from positioner.bus.port import BusPort
    from positioner.commissioning.procedure import Procedure
    from positioner.config.schema import Configuration
    from positioner.errors import PositionerError
    from positioner.wire.messages import CanFrame

RECEIVED = (StemPosition, ActuatorState, Setpoint, ManualCurrent)
_IDLE_WAIT_S = 0.1
_SHORTEST_WAIT_S = 0.001
_POLL_EVERY_S = 0.02
CLOSE_TIMEOUT_S = 5.0
_LEAST_CLOSE_S = 0.05
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """How a daemon runs, besides its configuration.

    setpoint_every: in lockstep, samples between two setpoint frames; 0 where the host keeps no such pace.
    dry_run: beside another controller; the daemon arms by itself, sends nothing and learns nothing.
    trace, record: their files; of several valves each has files of its own, with its name in theirs.
    procedure: a test procedure in place of the law; the daemon then arms by itself.
    """

    lockstep: bool = False
    setpoint_every: int = 0
    dry_run: bool = False
    trace: Path | None = None
    record: Path | None = None
    procedure: Procedure[Any] | None = None

    def of(self, name: str) -> RunOptions:
        """Return the options of the valve `name` among several: `run.csv` becomes `run-FV-101.csv`."""
        return replace(self, trace=_named(self.trace, name), record=_named(self.record, name)) if name else self


def _named(path: Path | None, name: str) -> Path | None:
    return path and path.with_name(f"{path.stem}-{name}{path.suffix}")


class Session:
    """One valve: `cycle` computes and sends. Its `name` is empty where the daemon has only this valve.

    port: the way to its bus; the daemon sets it.
    due_s: the monotonic instant at which a cycle is due, also without a frame, because time passes.
    ended: it has no more cycles.
    """

    port: BusPort

    def __init__(self, configuration: Configuration, options: RunOptions, time: TimePort, name: str = "") -> None:
        """Take the table over from the state directory.

        Raises:
            AlreadyRunningError: another process holds this valve's state.
            StateError: the state directory cannot be used.
            UsageError: the trace or the record cannot be written.
        """
        self._options, self._time = options, time
        self.announcer = Announcer(name, time)
        log = self.announcer.log
        self.table = LearnedTable(configuration, log)
        try:
            procedure = options.procedure
            law = None if procedure is None else procedure_law(procedure, configuration.valve, configuration.guard)
            self.setup = configuration.make_setup(plays=True, law=law)
            self._trace = TraceWriter(options.trace, log)
            self._recorder = BusRecorder(options.record, log)
        except Exception:
            self.table.close(CLOSE_TIMEOUT_S)
            raise
        if procedure is not None:
            self.setup = commissioning_setup(self.setup, procedure)
        if options.dry_run:
            self.setup = replace(self.setup, guard=replace(configuration.guard, auto_arm=True), learns=False)
        self._state = CycleState(table=self.table.initial)
        self.health = ValveHealth(configuration, self.table, log, testing=options.procedure is not None)
        shadow = configuration.make_shadow() if procedure is None else None
        self.shadow = Shadow(self.setup, shadow, log, time) if shadow else None
        codec, self._period_s = self.setup.codec, self.setup.period_s
        # a dry run runs beside a controller: the commands of that controller are not foreign to it
        kinds = RECEIVED if options.dry_run else (*RECEIVED, CurrentCommand)
        self.identifiers = tuple(codec.identifier(kind) for kind in kinds)
        self.clock: Clock = LockstepClock(codec, self._period_s) if options.lockstep else RealClock(time)
        self._gate = LockstepGate(codec, options.setpoint_every if options.lockstep else 0)
        self._lockstep = LockstepCheck(codec)
        self._other = OtherController()
        self._unsent = False
        self._lines_dropped = self._reported_dropped = 0
        self.due_s, self._poll_due_s = time.monotonic_s() + _IDLE_WAIT_S, 0.0
        self.ended = False

    @property
    def state(self) -> CycleState:
        """The state after the last cycle; only the session writes it, and only between two calls of `step`."""
        return self._state

    def put_memory(self, memory: Any) -> None:
        """Put another memory in the place of the law's, between two cycles."""
        self._state = replace(self._state, control=replace(self._state.control, memory=memory))

    def cycle(self, frames: tuple[CanFrame, ...], gap_ns: int) -> None:
        """Compute and send once; then report and keep the result. An empty cycle lets time pass.

        Nobody received for `gap_ns` before.

        Raises:
            AnotherControllerError: another controller goes on commanding this valve on the bus.
            UsageError: the plant does not wait, as one in lockstep does.
        """
        frames = self._gate.admit(frames)
        now_ns = self.clock.now_ns(frames)
        if not self.clock.is_real:  # when a frame arrived means nothing to a virtual clock
            frames = tuple(replace(frame, received_ns=0) for frame in frames)
        cycle_input = self._input(frames, now_ns, self._late_ns(gap_ns))
        before = self._state
        self._state, outbox, events = step(self.setup, before, cycle_input)
        if not self._options.dry_run:
            self._send(outbox, now_ns)
        if self._options.lockstep:
            self._lockstep.add(frames, answered=bool(outbox) and self.state.guard.transmits)
        self.announcer.cycle(events)  # before the table may log that it was replaced
        self._recorder.cycle(cycle_input, outbox, self.state.guard)
        self._trace.cycle(events)
        if not self._options.dry_run:
            self.health.cycle(cycle_input, before, self.state, outbox, events)
        self.table.record([event.sample for event in events if isinstance(event, Learned)])
        if self.shadow is not None:
            self.shadow.cycle(cycle_input, before, self._state, events)
        self._pass_time()
        self._other.check(events, now_ns, ever_armed=self.state.guard.arming.ever_armed)

    def _input(self, frames: tuple[CanFrame, ...], now_ns: int, late_ns: int) -> CycleInput:
        """Return all that the cycle is given from outside."""
        cycle_input = CycleInput(
            frames,
            now_ns,
            late_ns=late_ns,
            lines_dropped=self._lines_dropped - self._reported_dropped,
            table_saved=self.table.saved,
            unsent=self._unsent,
            table=self.table.take_replaced(),
            alarms=self.health.alarms,
        )
        self._reported_dropped, self._unsent = self._lines_dropped, False
        return cycle_input

    def _pass_time(self) -> None:
        """Look from time to time at what others did, and say when the next cycle is due."""
        now_s = self._time.monotonic_s()
        self.due_s = now_s + self._wait_s()
        if now_s >= self._poll_due_s:
            self._poll_due_s = now_s + _POLL_EVERY_S
            self.table.poll()
            if self.shadow is not None:
                self.shadow.flush()
            self._lines_dropped = dropped_lines()

    def _wait_s(self) -> float:
        """Return the time in s to wait for a frame: nothing is due before it is over."""
        if not self.state.guard.arming.armed:
            return _IDLE_WAIT_S
        return max(min(self._period_s, IDLE_COMMAND_PERIOD_S), _SHORTEST_WAIT_S)

    def _late_ns(self, gap_ns: int) -> int:
        """Return for how long nobody read the bus, in ns; 0 where that is at most a period, and before arming."""
        late = self.clock.is_real and self.state.guard.arming.armed and gap_ns > self._period_s * _NS
        return gap_ns if late else 0

    def _send(self, outbox: tuple[CanFrame, ...], now_ns: int) -> None:
        """Send the frames, unless a stall in the middle of the cycle has made them too old meanwhile."""
        guard = self.state.guard
        too_old_ns = deadline_ns(self.setup.guard, guard, self._period_s, now_ns) if self.clock.is_real else None
        sent = [self.port.send(frame, too_old_ns) for frame in outbox]
        if not all(sent[:1]):  # the command goes first
            self._unsent = True

    def start_again(self, error: Exception) -> None:
        """Begin anew after an unexpected error, as a new daemon would: not armed, with the table alone."""
        line, _ = unexpected(error)
        self.announcer.throttle.log(logging.ERROR, "failed", f"{line}; this valve starts again, not armed")
        self._state = CycleState(table=self._state.table)
        self._pass_time()

    def end(self, error: PositionerError) -> None:
        """Have no more cycles; the actuator's deadman acts."""
        self.ended = self.announcer.ready = True
        self.announcer.log.error("%s; this valve is not controlled any more", error)
        self.announcer.tell(f"ended: {error}")

    def begin_close(self) -> None:
        """Have the table and the health saved; `close` waits for it."""
        if not self._options.dry_run:
            self.health.hand_over()
        self.table.writer.begin_close()

    def close(self, timeout_s: float) -> str | None:
        """Save the table and end record and trace; return the error of the table, if there is one."""
        problem = self.table.close(timeout_s)
        if self.shadow is not None:
            self.shadow.close()
        self._recorder.close()
        self._trace.close()
        return problem


def open_sessions(configurations: Sequence[Configuration], options: RunOptions, time: TimePort) -> tuple[Session, ...]:
    """Return the sessions of all valves, or of none.

    Raises:
        PositionerError: as `Session`; among several valves with the name of the one that cannot be controlled.
    """
    sessions: list[Session] = []
    for configuration in configurations:
        name = configuration.valve.id if len(configurations) > 1 else ""
        try:
            sessions.append(Session(configuration, options.of(name), time, name))
        except Exception as error:
            close_sessions(sessions)
            if name:
                error.args = (f"valve {name}: {error}",)
            raise
    return tuple(sessions)


def close_sessions(sessions: Sequence[Session]) -> tuple[tuple[Session, str], ...]:
    """Save all tables, at the same time, and end all files; return each session whose table has an error, with it."""
    for session in sessions:
        session.begin_close()
    time = MachineTime()
    end_s = time.monotonic_s() + CLOSE_TIMEOUT_S
    problems = [(session, session.close(max(end_s - time.monotonic_s(), _LEAST_CLOSE_S))) for session in sessions]
    return tuple((session, problem) for session, problem in problems if problem)
