"""One daemon in a process of its own, of which strace lets one system call fail or wait; and the outcome.

The plant and the host of the run send the next reading as soon as the last one is answered, so that a thousand cycles
take seconds and a slow machine only makes them slower.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from daemon_helpers import HERE_M, Others, own_address, write_configuration

from positioner.errors import ExitCode
from positioner.start import TRACEBACK
from positioner.wire.messages import CurrentCommand, HostRequest, Mode, PositionerStatus, Setpoint, StemPosition

if TYPE_CHECKING:
    from pathlib import Path

PERIOD_S = 0.02
_MOST_UNANSWERED = 3
"""Periods of silence that are allowed without a FAILSAFE."""
_ANSWER_S = 1.0
"""How long a busy machine may take for one answer; a reading without one after that is unanswered."""
_TIMEOUT_S = 60.0
_STOP_S = 20.0
_WAITS_US = 2_000_000
_SILENCE_S = 1.5
"""After a longer silence there must be a FAILSAFE: 50 periods are 1 s, and a busy machine may add 0.5 s."""
WAIT = "wait"
"""The fault without an error: the call takes 2 s."""
DOCUMENTED = frozenset({ExitCode.SOFTWARE, ExitCode.SYSTEM, ExitCode.IO, ExitCode.TEMPORARY})
"""The exit statuses allowed after a passing fault: the service manager starts the daemon again."""


@dataclass(frozen=True, slots=True)
class Strike:
    """Which occasion of which system call is struck, counted from the start of the process, and how."""

    call: str
    occasion: int
    fault: str

    def options(self) -> list[str]:
        """Return the options of strace."""
        how = f"delay_enter={_WAITS_US}" if self.fault == WAIT else f"error={self.fault}"
        return [f"--trace={self.call}", f"--inject={self.call}:{how}:when={self.occasion}"]

    def __str__(self) -> str:
        return f"{self.call} no. {self.occasion}: {self.fault}"


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended; `fault` is what was wrong in a few words, empty where nothing was."""

    what: str
    fault: str = ""
    struck: bool = True


class Run:
    """A daemon under strace; `options` choose the calls that strace traces, and the one that it strikes."""

    def __init__(self, folder: Path, strace: list[str], options: list[str]) -> None:
        folder.mkdir(parents=True)
        self._folder = folder
        address = own_address()
        guard = {"feedback_failsafe_periods": 50, "setpoint_hold_s": 30.0, "setpoint_failsafe_s": 60.0}
        path = write_configuration(folder, address, guard=guard, control={"sample_period_s": PERIOD_S, "law": "pi"})
        self._others = Others(address)
        self._notified = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._notified.bind(str(folder / "notify"))
        self._notified.setblocking(False)
        environment = {key: value for key, value in os.environ.items() if key != TRACEBACK}
        with (folder / "stderr").open("wb") as error:
            self._process = subprocess.Popen(
                # -D: the daemon itself is our child, and strace runs beside it
                [*strace, "-D", "-qq", f"--output={folder / 'strace'}", *options,
                 sys.executable, "-m", "positioner", "run", "--config", str(path)],
                stdin=subprocess.DEVNULL, stdout=error, stderr=error,
                env={**environment, "NOTIFY_SOCKET": str(folder / "notify"), "OPENBLAS_NUM_THREADS": "1"},
            )  # fmt: skip
        self._failed_safe = False

    def play(self, cycles: int) -> Outcome:
        """Start, arm, run so many cycles and stop; return the outcome."""
        try:
            outcome = self._play(cycles)
        finally:
            self._process.kill()
            self._process.wait()
            self._others.port.close()
            self._notified.close()
        trace = (self._folder / "strace").read_text(encoding="utf-8", errors="replace")
        return Outcome(outcome.what, outcome.fault, "(INJECTED)" in trace or "(DELAYED)" in trace)

    def _play(self, cycles: int) -> Outcome:
        if not self._await_ready():
            return self._before_ready()
        answered = unanswered = 0
        longest_s, answered_s = 0.0, time.monotonic()
        deadline_s = answered_s + _TIMEOUT_S
        while answered < cycles:
            if self._is_answered(arm=answered == 0):
                before_s, answered_s = answered_s, time.monotonic()
                longest_s = max(longest_s, answered_s - before_s) if answered else 0.0
                answered, unanswered = answered + 1, 0
            elif answered:
                unanswered += 1
            if self._failed_safe:
                return self._stopped("failed safe")
            if self._process.poll() is not None:
                return Outcome("ended", f"with {self._process.returncode} after READY: {self._last_line()}")
            if unanswered > _MOST_UNANSWERED or time.monotonic() > deadline_s:
                return Outcome("silent", f"{unanswered} readings unanswered, and no FAILSAFE: {self._last_line()}")
        if longest_s > _SILENCE_S:
            return Outcome("silent", f"for {longest_s:.1f} s, and no FAILSAFE: {self._last_line()}")
        return self._stopped("went on")

    def _await_ready(self) -> bool:
        deadline_s = time.monotonic() + _TIMEOUT_S
        while time.monotonic() < deadline_s and self._process.poll() is None:
            with contextlib.suppress(BlockingIOError):
                while True:
                    if b"READY=1" in self._notified.recv(4096):
                        return True
            self._others.say(Setpoint(HERE_M), StemPosition(HERE_M))
            time.sleep(PERIOD_S)
        return "READY" in self._log_text()

    def _before_ready(self) -> Outcome:
        code = self._process.poll()
        if code is None:
            return Outcome("hung", f"neither READY nor an end within {_TIMEOUT_S:g} s: {self._last_line()}")
        # a library written in Rust may print lines of its own before
        is_one_line = self._last_line().startswith("positioner: ") and "Traceback" not in self._log_text()
        if code not in DOCUMENTED or not is_one_line:
            return Outcome("ended", f"status {code}, {len(self._log_text().splitlines())} lines: {self._last_line()}")
        return Outcome("ended before READY")

    def _is_answered(self, *, arm: bool) -> bool:
        """Send a reading, and return whether it was answered with a command."""
        while self._others.listen():  # a late command is no answer
            pass
        if arm:
            self._others.say(Setpoint(HERE_M, HostRequest.NONE), Setpoint(HERE_M, HostRequest.ARM))
        reading = self._others.frame(StemPosition(HERE_M))
        number = self._others._counters[StemPosition] - 1
        if number % 10 == 0 and not arm:
            self._others.say(Setpoint(HERE_M, HostRequest.ARM))
        assert self._others.port.send(reading)
        end_s = time.monotonic() + _ANSWER_S
        while (left_s := end_s - time.monotonic()) > 0.0:
            for message in self._others.listen(left_s):
                if isinstance(message, CurrentCommand | PositionerStatus):
                    self._failed_safe = self._failed_safe or message.mode is Mode.FAILSAFE
                if isinstance(message, CurrentCommand):  # in HOLD the last one is repeated
                    return True
            if self._failed_safe or self._process.poll() is not None:
                return False
        return False

    def _stopped(self, what: str) -> Outcome:
        """Return the outcome of a run that is stopped now."""
        self._process.send_signal(signal.SIGTERM)
        try:
            code = self._process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            return Outcome(what, f"SIGTERM has no effect: {self._last_line()}")
        if code not in {ExitCode.OK, *DOCUMENTED} or "Traceback" in self._log_text():
            return Outcome(what, f"stops with {code}: {self._last_line()}")
        if self._failed_safe and "-> FAILSAFE (" not in self._log_text():
            return Outcome(what, "a FAILSAFE on the bus that is not in the log")
        return Outcome(what)

    def _log_text(self) -> str:
        return (self._folder / "stderr").read_text(encoding="utf-8", errors="replace")

    def _last_line(self) -> str:
        return (self._log_text().splitlines() or ["no output"])[-1]
