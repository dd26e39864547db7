"""A daemon as a process, on an embedded bus, that is stopped and continued while a plant and a host send frames to it.

A third socket receives all frames: the kernel stamps each of them there when it is sent.
"""

from __future__ import annotations

import signal
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from daemon_helpers import HERE_M, PERIOD_S, TIMEOUT_S, Service

from positioner.bus.port import BusPort
from positioner.guard.settings import GuardSettings
from positioner.wire.messages import CurrentCommand, HostRequest, Mode, Setpoint, StemPosition

if TYPE_CHECKING:
    import random
    from pathlib import Path
    from types import TracebackType

    from positioner.wire.messages import CanFrame

_QUIET_S = 1.2
"""Longer than the time in which the log writes only one line of a kind."""
_AFTER_S = 0.5
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Stop:
    """One stop: its least duration, the ages of the readings that commands answered, and the daemon's reaction."""

    stall_s: float
    ages_s: tuple[float, ...]
    latched: bool
    logged: bool


class StoppedDaemon:
    """The daemon, and the test that is its plant and its host, one frame of each every period."""

    def __init__(self, folder: Path) -> None:
        """Start it."""
        self._service = Service(folder, control={"law": "pi", "sample_period_s": PERIOD_S})
        guard = GuardSettings()
        self.hold_s, self.failsafe_s = (
            guard.feedback_hold_periods * PERIOD_S,
            guard.feedback_failsafe_periods * PERIOD_S,
        )
        self._observer = BusPort(self._service.address)
        self._observer.open()
        self._request = HostRequest.NONE
        self._due_s = time.monotonic()
        self._acting: int | None = None
        self._mode: Mode | None = None
        self._read_ns: dict[int, int] = {}
        self._ages_s: list[float] = []

    def make_ready(self) -> None:
        """Let it be ACTIVE for a while; arm it again if necessary."""
        deadline_s, active_s, periods = time.monotonic() + TIMEOUT_S, None, 0
        while active_s is None or time.monotonic() - active_s < _QUIET_S:
            assert time.monotonic() < deadline_s, self._service.lines[-20:]
            if self._mode is not Mode.ACTIVE:
                self._request = (HostRequest.NONE, HostRequest.ARM)[periods // 10 % 2]
            self._period()
            periods += 1
            active_s = None if self._mode is not Mode.ACTIVE else active_s or time.monotonic()

    def stop_for(self, stall_s: float, chance: random.Random) -> Stop:
        """Stop it for `stall_s` at a random instant of a period, and return how the daemon reacted."""
        pid, lines = self._service.child.process.pid, len(self._service.lines)
        self._ages_s.clear()
        self._period(chance.uniform(0.0, PERIOD_S))
        self._service.child.process.send_signal(signal.SIGSTOP)
        while (state := _state_of(pid)) not in {"T", "t"}:
            assert state, f"process {pid} has ended"
        stopped_s = time.monotonic()
        while (left_s := stopped_s + stall_s - time.monotonic()) > 0.0:
            self._period(min(left_s, PERIOD_S))
        held_s = time.monotonic() - stopped_s
        self._service.child.process.send_signal(signal.SIGCONT)
        end_s = time.monotonic() + _AFTER_S
        while time.monotonic() < end_s:
            self._period()
        new_lines = self._service.lines[lines:]
        return Stop(
            held_s,
            tuple(self._ages_s),
            self._mode is Mode.FAILSAFE,
            any("-> FAILSAFE" in line for line in new_lines) and any("stood still for" in line for line in new_lines),
        )

    def _period(self, duration_s: float = PERIOD_S) -> None:
        """Let up to a period pass, and send what is due at its end."""
        end_s = time.monotonic() + duration_s
        while (left_s := min(end_s, self._due_s) - time.monotonic()) > 0.0:
            for frame in self._observer.receive(left_s):
                self._receive(frame)
        if time.monotonic() >= self._due_s:
            self._due_s = max(self._due_s + PERIOD_S, time.monotonic())
            self._service.others.say(Setpoint(HERE_M, self._request), StemPosition(HERE_M, self._acting))

    def _receive(self, frame: CanFrame) -> None:
        message, counter = self._service.others.codec.decode(frame)
        match message:
            case StemPosition() if counter is not None:
                self._read_ns[counter] = frame.received_ns
            case CurrentCommand():
                self._acting, self._mode = counter, message.mode
                read_ns = self._read_ns.get(message.position_counter or 0)
                if message.mode is Mode.ACTIVE and read_ns is not None:
                    self._ages_s.append((frame.received_ns - read_ns) / _NS)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._service.child.process.send_signal(signal.SIGCONT)
        self._observer.close()
        self._service.__exit__(kind, error, trace)


def _state_of(pid: int) -> str:
    """Return the state of a process from /proc."""
    try:
        with open(f"/proc/{pid}/stat", encoding="ascii") as file:  # noqa: PTH123 - the quickest way to it
            return file.read().rpartition(") ")[2][:1]
    except FileNotFoundError:
        return ""
