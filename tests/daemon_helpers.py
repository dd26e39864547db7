"""Daemons under test, in this process or in one of their own; the test plays the other nodes on their bus."""

from __future__ import annotations

import logging
import secrets
import signal
import time
from typing import TYPE_CHECKING, Any, Self, TypeVar

import tomli_w

from positioner.bench.processes import BenchProcess
from positioner.bus.address import BusAddress, embedded_address
from positioner.bus.port import BusPort
from positioner.config.reader import load_config
from positioner.machine.journal import logger
from positioner.runtime.daemon import Daemon
from positioner.runtime.session import RunOptions
from positioner.runtime.shared_bus import WAITING
from positioner.wire.codec import Codec, make_codec
from positioner.wire.messages import (
    CanFrame,
    CurrentCommand,
    HostRequest,
    Message,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

    from positioner.config.schema import Configuration
    from positioner.errors import ExitCode

TIMEOUT_S = 240.0
"""The longest time that a test waits on a busy machine."""
PERIOD_S = 0.02
HERE_M = 0.08
_NS = 1_000_000_000
T = TypeVar("T")


def own_address() -> BusAddress:
    """Return an embedded bus that nobody else uses, neither in this process nor in another."""
    return embedded_address(secrets.randbits(32))


def write_configuration(folder: Path, bus: BusAddress, **tables: dict[str, Any]) -> Path:
    """Write the configuration of a valve on `bus`, with its state beside it, and return its path."""
    values: dict[str, Any] = {
        "valve": {"id": "FV-101", "preset": "paper"},
        "bus": {"interface": bus.interface, "channel": bus.channel, "port": bus.port},
        "state": {"directory": str(folder / "state")},
        **tables,
    }
    values["control"] = {"sample_period_s": PERIOD_S, **tables.get("control", {})}
    path = folder / "valve.toml"
    path.write_text(tomli_w.dumps(values), encoding="utf-8")
    return path


class Others:
    """The plant and the host on a bus: they number their frames, and understand the positioner's."""

    def __init__(self, address: BusAddress, codec: Codec | None = None) -> None:
        self.codec = codec or make_codec()
        self.port = BusPort(address)
        self.port.open()
        self.received: list[CanFrame] = []
        self._counters = {StemPosition: 0, Setpoint: 0, CurrentCommand: 0}

    def frame(self, message: StemPosition | Setpoint | CurrentCommand) -> CanFrame:
        """Return the next frame of that kind of message."""
        counter = self._counters[type(message)]
        self._counters[type(message)] = counter + 1
        return self.codec.encode(message, counter)

    def say(self, *messages: StemPosition | Setpoint | CurrentCommand) -> None:
        for message in messages:
            assert self.port.send(self.frame(message))

    @property
    def acting(self) -> int | None:
        """The counter of the newest command received, which acts on a valve that obeys; None before the first."""
        frames = (frame for frame in reversed(self.received) if not frame.is_error and not frame.is_remote)
        decoded = (self.codec.decode(frame) for frame in frames)
        return next((counter for message, counter in decoded if isinstance(message, CurrentCommand)), None)

    def report(self, position_m: float = HERE_M) -> None:
        self.say(StemPosition(position_m))

    def ask(self, setpoint_m: float = HERE_M, request: HostRequest = HostRequest.NONE) -> None:
        self.say(Setpoint(setpoint_m, request))

    def listen(self, timeout_s: float = 0.0) -> list[Message]:
        """Return the messages received since the last call."""
        frames = self.port.receive(timeout_s)
        self.received += frames
        return [self.codec.decode(frame)[0] for frame in frames if not frame.is_error and not frame.is_remote]


class Loop:
    """A daemon in this process, run by the test, cycle by cycle, under a clock of the test."""

    is_real = False
    """The machine's time is not the test's: no frame is old, and no cycle is late."""

    def __init__(
        self, folder: Path, options: RunOptions | None = None, bus: BusAddress | None = None, **tables: dict[str, Any]
    ) -> None:
        self.address = bus or own_address()
        self.configuration: Configuration = load_config(write_configuration(folder, self.address, **tables))
        self.lines: list[str] = []
        self._handler = logging.Handler()
        self._handler.emit = lambda record: self.lines.append(record.getMessage())  # type: ignore[method-assign]
        logger.addHandler(self._handler)
        self._level = logger.level
        logger.setLevel(logging.DEBUG)
        self.others = Others(self.address)
        self.daemon = Daemon((self.configuration,), options or RunOptions())
        (self.session,) = self.daemon.sessions
        self._running: Daemon | None = self.daemon
        self.session.clock = self
        self.elapsed_ns = _NS
        self.daemon._cycle()

    def now_ns(self, frames: tuple[CanFrame, ...]) -> int:
        """Return the daemon's time in ns; only `cycle` advances it."""
        del frames
        return self.elapsed_ns

    def cycle(self, *frames: CanFrame, after_s: float = PERIOD_S) -> list[Message]:
        """Send `frames`, let `after_s` pass and run one cycle; return the messages it sent."""
        for frame in frames:
            assert self.others.port.send(frame)
        self.elapsed_ns += round(after_s * _NS)
        self.daemon._cycle()
        return self.others.listen()

    def sample(self, position_m: float = HERE_M, setpoint_m: float | None = HERE_M) -> list[Message]:
        """Run one period with a reading of a valve that obeys, and a setpoint; return the messages of the daemon."""
        frames = [self.others.frame(StemPosition(position_m, self.others.acting))]
        if setpoint_m is not None:
            frames.insert(0, self.others.frame(Setpoint(setpoint_m)))
        return self.cycle(*frames)

    def request(self, request: HostRequest) -> list[Message]:
        """Run one period with a reading and a request; an ARM follows another request, so that it counts."""
        if request is HostRequest.ARM:
            self.request(HostRequest.NONE)
        reading = self.others.frame(StemPosition(HERE_M))
        return self.cycle(reading, self.others.frame(Setpoint(HERE_M, request)))

    def cycle_until(self, word: str) -> None:
        """Let samples pass until the log has a line with `word`."""
        deadline_s = time.monotonic() + TIMEOUT_S
        while not self.logged(word):
            assert time.monotonic() < deadline_s, self.lines
            self.sample()

    def logged(self, word: str) -> list[str]:
        """Return the lines of the log that hold `word`."""
        return [line for line in self.lines if word in line]

    def close(self) -> ExitCode | None:
        """End the daemon as a signal would, and return its exit status, once."""
        daemon, self._running = self._running, None
        return daemon._close() if daemon else None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
        self.others.port.close()
        logger.removeHandler(self._handler)
        logger.setLevel(self._level)


class Service:
    """A daemon in a process of its own, as a service manager runs it."""

    def __init__(
        self,
        folder: Path,
        *arguments: str,
        codec: Codec | None = None,
        bus: BusAddress | None = None,
        **tables: dict[str, Any],
    ) -> None:
        self.folder = folder
        self.address = bus or own_address()
        self.others = Others(self.address, codec)
        self.path = write_configuration(folder, self.address, **tables)
        self.child = self.start(*arguments)

    def start(self, *arguments: str) -> BenchProcess:
        """Start the daemon, or start it again, and return it as soon as it receives."""
        self.child = BenchProcess("positioner.cli.main", ["run", "--config", str(self.path), *arguments], self.log)
        self.child.wait_for(WAITING)
        return self.child

    @property
    def log(self) -> Path:
        return self.folder / "daemon.log"

    @property
    def lines(self) -> list[str]:
        return self.log.read_text(encoding="utf-8").splitlines()

    def logged(self, word: str) -> list[str]:
        return [line for line in self.lines if word in line]

    def next(self, kind: type[T]) -> T:
        """Send a reading and a setpoint every period; return the next message of that kind from the daemon."""
        deadline_s = time.monotonic() + TIMEOUT_S
        while True:
            self.others.ask()
            self.others.report()
            for message in self.others.listen(PERIOD_S):
                if isinstance(message, kind):
                    return message
            assert time.monotonic() < deadline_s, (kind, self.lines)

    def request(self, request: HostRequest) -> list[Message]:
        """Run one period with a reading and a request; return the messages of the daemon."""
        self.others.report()
        self.others.ask(request=request)
        return self.others.listen(PERIOD_S)

    def arm(self) -> None:
        """Send a request to arm, again every second period, until the first command has come."""
        deadline_s = time.monotonic() + TIMEOUT_S
        while True:
            for request in (HostRequest.NONE, HostRequest.ARM):
                if any(isinstance(message, CurrentCommand) for message in self.request(request)):
                    return
            assert time.monotonic() < deadline_s, self.lines

    def stop(self) -> int:
        return self.child.stop()

    def kill(self) -> None:
        self.child.process.send_signal(signal.SIGKILL)
        self.child.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.child.stop()
        self.others.port.close()
