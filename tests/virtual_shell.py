"""A daemon in this process whose ports lead to a virtual world: clocks, a bus, and a plant and a host on it.

Only the ports are replaced: bus port, clocks, loop, log and table writer are the product's. Time passes where the loop
waits, and a little at each look at the clock. A *stall* lets much of it pass at one such place, while plant and host go
on sending, and the kernel stamps and queues their frames.
"""

from __future__ import annotations

import logging
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

import can
from daemon_helpers import write_configuration

from positioner.bus.address import BusAddress
from positioner.bus.port import Ports
from positioner.config.reader import load_config
from positioner.machine.journal import logger
from positioner.machine.time import Instant
from positioner.runtime.daemon import Daemon
from positioner.runtime.session import RunOptions
from positioner.wire.messages import CanFrame, Cause, CurrentCommand, HostRequest, Message, Mode, Setpoint, StemPosition

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path
    from types import TracebackType

HERE_M = 0.08
_NS = 1_000_000_000
_BOOT_NS = 5_000 * _NS
_WALL_NS = 1_700_000_000 * _NS
_LOOK_NS = 2_000
_QUEUE_FRAMES = 5_000
_SETPOINT_EVERY = 10


@dataclass
class Sent:
    """A command or status of the daemon, and when it was sent; `answered_ns`: when the echoed reading was sent."""

    at_ns: int
    message: Message
    answered_ns: int | None


@dataclass
class Queued:
    """A frame in the receive queue, and when it came."""

    message: can.Message
    at_ns: int
    counter: int
    is_position: bool


@dataclass
class World:
    """Virtual time, and the plant and the host in it.

    struck: called at each look at the clock and each wait; returns the stall in ns that happens there.
    strike: the next stall: its instant and its duration in ns.
    request: what the host asks for, None while it is silent; asks: the next ones, with their instants in ns.
    arm_queued_ns: when the queue took the first ARM after another request; None while the last one it took is no ARM.
    compute_ns: returns the computing time in ns that passes before each look at the monotonic clock.
    """

    period_ns: int
    codec: Any = None
    now_ns: int = _BOOT_NS
    wall_step_ns: int = 0
    request: HostRequest | None = HostRequest.NONE
    asks: deque[tuple[int, HostRequest | None]] = field(default_factory=deque)
    arm_queued_ns: int | None = None
    stamps: bool = True
    struck: Callable[[], int] = lambda: 0
    queue: deque[Queued] = field(default_factory=deque)
    sent: list[Sent] = field(default_factory=list)
    sample: int = 0
    setpoints: int = 0
    read_ns: dict[int, int] = field(default_factory=dict)
    plant_silent: bool = False
    acting: int | None = None
    strike: tuple[int, int] | None = None
    compute_ns: Callable[[], int] = lambda: 0

    # in the place of the machine's clocks

    def instant(self) -> Instant:
        self._look()
        return Instant(self.now_ns, self.now_ns + _WALL_NS - _BOOT_NS + self.wall_step_ns)

    def monotonic_ns(self) -> int:
        self.pass_time(self.compute_ns())
        self._look()
        return self.now_ns

    def monotonic_s(self) -> float:
        return self.now_ns / _NS

    def sleep(self, duration_s: float) -> None:
        self.pass_time(round(duration_s * _NS))

    # in the place of python-can's bus

    def recv(self, timeout: float | None) -> can.Message | None:
        end_ns = self.now_ns + round((timeout or 0.0) * _NS)
        self.pass_time(self.struck())
        while not self.queue and self.now_ns < end_ns:
            self.pass_time(min(self._next_ns, end_ns) - self.now_ns)
        if not self.queue:
            return None
        queued = self.queue.popleft()
        if queued.is_position:
            self.read_ns[queued.counter % 256] = queued.at_ns
        return queued.message

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        del timeout
        decoded, counter = self.codec.decode(CanFrame(message.arbitration_id, bytes(message.data)))
        answered = None
        if isinstance(decoded, CurrentCommand):
            self.acting, answered = counter, decoded.position_counter
        self.sent.append(Sent(self.now_ns, decoded, None if answered is None else self.read_ns.get(answered)))

    def shutdown(self) -> None:
        pass

    def open(self, _address: BusAddress, _wanted: Iterable[tuple[int, bool]]) -> Any:
        """Return the bus, as `bus.opening.open_bus` does."""
        return self

    # the world

    def pass_time(self, duration_ns: int) -> None:
        """Let `duration_ns` pass, and the stall that begins meanwhile, if there is one."""
        end_ns = self.now_ns + duration_ns
        if self.strike is not None and self.strike[0] <= end_ns:
            (at_ns, stall_ns), self.strike = self.strike, None
            self._live_until(at_ns + stall_ns)
            end_ns += stall_ns
        self._live_until(end_ns)

    def _live_until(self, end_ns: int) -> None:
        """Let plant and host send their frames until `end_ns`."""
        while self._next_ns <= end_ns:
            self.now_ns = self._next_ns
            if not self.plant_silent:
                self._deliver(StemPosition(HERE_M + 1e-7 * (self.sample % 7), self.acting), self.sample)
            while self.asks and self.asks[0][0] <= self.now_ns:
                self.request = self.asks.popleft()[1]
            if self.sample % _SETPOINT_EVERY == 0 and self.request is not None:
                self._deliver(Setpoint(HERE_M, self.request), self.setpoints)
                self.setpoints += 1
            self.sample += 1
        self.now_ns = end_ns

    @property
    def _next_ns(self) -> int:
        return _BOOT_NS + (self.sample + 1) * self.period_ns

    def _deliver(self, message: Message, counter: int) -> None:
        frame = self.codec.encode(message, counter)
        wall_ns = self.now_ns + _WALL_NS - _BOOT_NS + self.wall_step_ns
        if len(self.queue) < _QUEUE_FRAMES:
            received = can.Message(
                timestamp=wall_ns / _NS if self.stamps else 0.0,
                arbitration_id=frame.arbitration_id,
                data=frame.data,
                is_extended_id=False,
            )
            self.queue.append(Queued(received, self.now_ns, counter, isinstance(message, StemPosition)))
            if isinstance(message, Setpoint):
                is_arm = message.request is HostRequest.ARM
                self.arm_queued_ns = (self.arm_queued_ns or self.now_ns) if is_arm else None

    def _look(self) -> None:
        self.pass_time(self.struck() + _LOOK_NS)


class VirtualShell:
    """A daemon with the world behind its ports, run by the test, cycle by cycle."""

    def __init__(
        self,
        folder: Path,
        period_s: float = 0.01,
        options: RunOptions | None = None,
        world: type[World] = World,
        **tables: Any,
    ) -> None:
        tables = {**tables, "control": {"sample_period_s": period_s, "law": "pi", **tables.get("control", {})}}
        path = write_configuration(folder, BusAddress(interface="virtual", channel="none"), **tables)
        configuration = load_config(path)
        self.period_s = period_s
        self.world = world(round(period_s * _NS), configuration.make_codec())
        self.lines: list[str] = []
        self._handler = logging.Handler()
        self._handler.emit = lambda record: self.lines.append(record.getMessage())  # type: ignore[method-assign]
        logger.addHandler(self._handler)
        self._level = logger.level
        logger.setLevel(logging.DEBUG)
        self._configuration, self._options = configuration, options or RunOptions()
        self.start_again()

    def start_again(self) -> None:
        """Put a new daemon in the place of the one that has ended."""
        self.daemon = Daemon((self._configuration,), self._options, Ports(self.world, self.world.open))
        (self.session,) = self.daemon.sessions

    def mode(self) -> Mode:
        return self.session.state.guard.mode

    def mode_and_cause(self) -> tuple[Mode, Cause]:
        return self.session.state.guard.mode, self.session.state.guard.cause

    def cycle(self, count: int = 1) -> None:
        for _ in range(count):
            self.daemon._cycle()

    def cycle_for(self, duration_s: float) -> None:
        """Run cycles until `duration_s` has passed."""
        end_ns = self.world.now_ns + round(duration_s * _NS)
        while self.world.now_ns < end_ns:
            self.daemon._cycle()

    def arm(self) -> None:
        """Send NONE and then ARM, each long enough to be received."""
        for request in (HostRequest.NONE, HostRequest.ARM):
            self.world.request = request
            self.cycle_for(2 * _SETPOINT_EVERY * self.period_s)

    def logged(self, word: str) -> list[str]:
        return [line for line in self.lines if word in line]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.daemon._close()
        logger.removeHandler(self._handler)
        logger.setLevel(self._level)
