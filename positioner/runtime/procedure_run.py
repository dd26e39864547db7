"""The daemon's loop with a test procedure in place of the law, from the first reading to its end. Shell."""

from __future__ import annotations

import gc
import math
import signal
from typing import TYPE_CHECKING, Any

from positioner.commissioning.procedure import aborted_by, ended_by, load_remedy
from positioner.errors import PositionerError
from positioner.runtime.daemon import Daemon
from positioner.values import replace
from positioner.wire.messages import Counted
from positioner.wire.words import in_words

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

    from positioner.bus.port import Ports
    from positioner.commissioning.procedure import Procedure, Progress
    from positioner.config.schema import Configuration
    from positioner.cycle.state import CycleState
    from positioner.errors import ExitCode
    from positioner.runtime.session import RunOptions
    from positioner.wire.messages import Cause, Mode

_BEGINS_WITHIN_S = 10.0
_LOOK_EVERY_S = 0.1
"""Between two reports of the progress."""


class ProcedureError(PositionerError):
    """A test procedure that could not be completed; the message gives the reason."""


class ProcedureRun(Daemon):
    """Runs one procedure on one valve.

    A first SIGINT or SIGTERM lets the procedure bring the stem back; a second one ends the run at once. So does every
    trip of the guard that makes commands useless or dangerous. Where feedback stays away for a moment, the procedure is
    aborted, and brings the stem back when feedback returns. A stall of this process loses some readings, and no more.

    memory: that of the procedure after the last cycle. ended_because: why it ended before its time, empty where it did
    not. remedy: what to do where a busy machine may be the reason, empty where it is not.
    """

    def __init__(
        self,
        configuration: Configuration,
        options: RunOptions,
        procedure: Procedure[Any],
        show: Callable[[Progress], object],
        ports: Ports | None = None,
    ) -> None:
        """Take the state directory, as a daemon does; `show` is called with the progress.

        Raises:
            AlreadyRunningError: another process holds the valve's state.
            StateError: the state directory cannot be used.
        """
        super().__init__((configuration,), replace(options, procedure=procedure), ports)
        self._procedure = procedure
        self._show = show
        self._begun = False
        self._shown_s = 0.0
        self._wait_until_s = self._time.monotonic_s() + _BEGINS_WITHIN_S
        self._signals = 0
        self._start_m = math.nan
        self.memory: Any = None
        self.ended_because = self.remedy = ""

    def run(self) -> ExitCode:
        """Run until the procedure has ended; then signals end the command again, while the record is evaluated."""
        before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
        try:
            return super().run()
        finally:
            gc.enable()
            gc.unfreeze()
            for number, handler in before.items():
                signal.signal(number, handler)

    def result(self) -> Any:
        """Return the memory of the procedure at its end.

        Raises:
            ProcedureError: it did not come to its end.
        """
        aborted = self._procedure.progress(self.memory).aborted if self._begun else ""
        reasons = [reason for reason in (aborted, self.ended_because) if reason]
        if reasons:
            parts = (f"{self._procedure.name}: {reasons[0]}", *reasons[1:], self._whereabouts(), self.remedy)
            raise ProcedureError("; ".join(part for part in parts if part))
        return self.memory

    def _whereabouts(self) -> str:
        """Return how far from its start the stem was at the last reading, in words; empty where it never began."""
        last_m = self.sessions[0].state.link.feedback.readings.position_m
        if not self._begun or last_m is None:
            return ""
        return f"at the last reading the stem was {abs(last_m - self._start_m) * 1e3:.1f} mm from its start"

    def _cycle(self) -> None:
        super()._cycle()
        state = self.sessions[0].state
        mode, cause = state.guard.mode, state.guard.cause
        if state.control.memory is None:
            self._look_before(state, mode, cause)
            return
        if not self._begun and state.link.feedback.readings.position_m is not None:
            self._start_m = state.link.feedback.readings.position_m
        self._begun, self.memory = True, state.control.memory
        if ended := ended_by(mode, cause):
            self._end(ended, state)
        elif self._signals > 1:
            self._end("stopped at once by a second signal")
        else:
            self._go_on(state, mode, cause)

    def _go_on(self, state: CycleState, mode: Mode, cause: Cause) -> None:
        """Abort the procedure where that is due, and show how far it is."""
        if why := aborted_by(mode, cause):
            self.remedy = self.remedy or _remedy(state)
        elif self._signals:
            why = "stopped by a person"
        if why:
            self.memory = self._procedure.abort(self.memory, why)
            self.sessions[0].put_memory(self.memory)
        now_s = self._time.monotonic_s()
        progress = self._procedure.progress(self.memory)
        if progress.ended or now_s >= self._shown_s:
            self._shown_s = now_s + _LOOK_EVERY_S
            self._show(progress)
        self._stopping |= progress.ended

    def _look_before(self, state: CycleState, mode: Mode, cause: Cause) -> None:
        """Look at a positioner that does not control: not yet, or not any more."""
        if self._begun:
            self._end(ended_by(mode, cause) or f"it failed: {in_words(cause)}", state)
        elif self._signals:
            self._end("stopped before it began")
        elif self._time.monotonic_s() > self._wait_until_s:
            self._end(f"did not begin within {_BEGINS_WITHIN_S:g} s: {in_words(cause)}")

    def _end(self, because: str, by_guard: CycleState | None = None) -> None:
        """End the run; where the guard has ended it in the state `by_guard`, the machine may have been too busy."""
        self.ended_because = because
        self._stopping = True
        if by_guard is not None:
            self.remedy = self.remedy or _remedy(by_guard)

    def _stop(self, number: int, frame: FrameType | None) -> None:
        """Count a signal, and no more: it may come within a cycle, and the loop looks after each."""
        del number, frame
        self._signals += 1


def _remedy(state: CycleState) -> str:
    """Return what to do where the machine was too busy for the procedure; empty where nothing says so."""
    counts = state.counters.by_cause
    return load_remedy(state.guard.cause, counts.get(Counted.LAW_LATE, 0), counts.get(Counted.STALLED, 0))
