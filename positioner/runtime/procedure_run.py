"""The daemon's loop with a test procedure in place of the law, from the first reading to its end. Shell."""

from __future__ import annotations

import gc
import signal
from typing import TYPE_CHECKING, Any

from positioner.commissioning.procedure import aborted_by, ended_by
from positioner.errors import PositionerError
from positioner.runtime.daemon import Daemon
from positioner.values import replace
from positioner.wire.words import in_words

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

    from positioner.bus.port import Ports
    from positioner.commissioning.procedure import Procedure, Progress
    from positioner.config.schema import Configuration
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
        self._interrupted = False
        self.memory: Any = None
        self.ended_because = ""

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
            raise ProcedureError(f"{self._procedure.name}: {'; then '.join(reasons)}")
        return self.memory

    def _cycle(self) -> None:
        super()._cycle()
        session = self.sessions[0]
        state = session.state
        if state.control.memory is None:
            self._look_before(state.guard.mode, state.guard.cause)
            return
        self._begun, self.memory = True, state.control.memory
        mode, cause = state.guard.mode, state.guard.cause
        if ended := ended_by(mode, cause):
            self._end(ended)
            return
        if why := aborted_by(mode, cause):
            self._abort(why)
        now_s = self._time.monotonic_s()
        progress = self._procedure.progress(self.memory)
        if progress.ended or now_s >= self._shown_s:
            self._shown_s = now_s + _LOOK_EVERY_S
            self._show(progress)
        self._stopping |= progress.ended

    def _look_before(self, mode: Mode, cause: Cause) -> None:
        """Look at a positioner that does not control: not yet, or not any more."""
        if self._begun:
            self._end(ended_by(mode, cause))
        elif self._time.monotonic_s() > self._wait_until_s:
            self.ended_because = f"did not begin within {_BEGINS_WITHIN_S:g} s: {in_words(cause)}"
            self._stopping = True

    def _end(self, because: str) -> None:
        self.ended_because = because
        self._stopping = True

    def _abort(self, why: str) -> None:
        """Let the procedure bring the stem back."""
        session = self.sessions[0]
        self.memory = self._procedure.abort(session.state.control.memory, why)
        session.state = replace(session.state, control=replace(session.state.control, memory=self.memory))

    def _stop(self, number: int, frame: FrameType | None) -> None:
        if self._interrupted or not self._begun:
            self.ended_because = "stopped at once; the stem is where it was at that moment"
            super()._stop(number, frame)
            return
        self._interrupted = True
        self._abort("stopped by a person; the stem was brought back to its start")
