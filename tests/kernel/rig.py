"""A valve on a bus, as it would run: emulator and positioner as processes, the test as their host."""

from __future__ import annotations

import itertools
import signal
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self, TypeVar

from daemon_helpers import write_configuration
from links import TIMEOUT_S

from positioner.bench.processes import BenchProcess
from positioner.bus.port import BusPort
from positioner.wire.codec import make_codec
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import (
    CurrentCommand,
    HostRequest,
    Message,
    Mode,
    PlantTruth,
    PositionerStatus,
    Setpoint,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from types import TracebackType

    from positioner.bus.address import BusAddress

PERIOD_S = 0.02
HOLD_PERIODS = 25
FAILSAFE_PERIODS = 100
DEADMAN_S = 1.0
"""Limits that a busy machine does not reach by itself, and for which a test can still wait."""
NEAR_M = 0.010
"""Near enough to distinguish a valve that obeys from one that does not, at so long a period."""
LOW_M, HIGH_M = 0.066, 0.088
CLOSED_M = 1423.0 / 52538.0
"""The rest position of the paper's valve without pressure: F_c/K, at which sliding friction stops the spring."""
_PLANT = f"""preset = "paper"
deadman_s = {DEADMAN_S}
fail_position = "close"
"""
M = TypeVar("M", bound=Message)


@dataclass
class Received:
    """The messages that the host of a rig has received: the newest of each kind, and their numbers."""

    newest: dict[type, Message] = field(default_factory=dict)
    counts: Counter[type] = field(default_factory=Counter)
    refused: int = 0


class Rig:
    """One valve on one bus. `step` is a period of the host: it sends a setpoint and receives frames."""

    def __init__(self, folder: Path, bus: BusAddress, **tables: dict[str, Any]) -> None:
        self.folder, self.bus = folder, bus
        self.codec = make_codec()
        self.port = BusPort(bus)
        self.port.open()
        self.received = Received()
        self.setpoint_m = 0.08
        self.request = HostRequest.NONE
        self._numbers = itertools.count()
        guard = {
            "max_jump_m": 0.14,  # in one such period the emulated stem, which has no lag, crosses its whole travel
            "feedback_hold_periods": HOLD_PERIODS,
            "feedback_failsafe_periods": FAILSAFE_PERIODS,
            "setpoint_hold_s": 20.0,
            "setpoint_failsafe_s": 60.0,
            **tables.pop("guard", {}),
        }
        control = {"sample_period_s": PERIOD_S, "law": "nmpc", **tables.pop("control", {})}
        self.path = write_configuration(folder, bus, guard=guard, control=control, **tables)
        plant = folder / "plant.toml"
        plant.write_text(_PLANT, encoding="utf-8")
        self.plant = BenchProcess(
            "plant_emulator.cli.main",
            ["run", "--config", str(plant), "--bus", str(bus), "--period", str(PERIOD_S)],
            folder / "plant.log",
        )
        self.daemon = self.start_daemon()

    def start_daemon(self) -> BenchProcess:
        """Start the positioner, or start it again."""
        self.daemon = BenchProcess(
            "positioner.cli.main", ["run", "--config", str(self.path)], self.folder / "daemon.log"
        )
        self.daemon.wait_for("READY=1")
        return self.daemon

    @property
    def lines(self) -> list[str]:
        """The lines of the positioner's log."""
        return (self.folder / "daemon.log").read_text(encoding="utf-8").splitlines()

    def logged(self, word: str) -> list[str]:
        return [line for line in self.lines if word in line]

    def step(self, *, asks: bool = True) -> None:
        """Run one period of the host; with `asks` it sends a setpoint."""
        if asks:
            frame = self.codec.encode(Setpoint(self.setpoint_m, self.request), next(self._numbers))
            self.port.send(frame)
        end_s = time.monotonic() + PERIOD_S
        while (left_s := end_s - time.monotonic()) > 0.0:
            for frame in self.port.receive(left_s):
                if frame.is_error or frame.is_remote:
                    continue
                try:
                    message, _ = self.codec.decode(frame)
                except FrameRejectedError:
                    self.received.refused += 1
                else:
                    self.received.newest[type(message)] = message
                    self.received.counts[type(message)] += 1
        for child in (self.plant, self.daemon):
            if child.process.poll() is None:
                child.drain()

    def until(self, holds: Callable[[], object], timeout_s: float = TIMEOUT_S, *, asks: bool = True) -> None:
        """Let periods pass until `holds`."""
        deadline_s = time.monotonic() + timeout_s
        while not holds():
            assert time.monotonic() < deadline_s, self.story()
            self.step(asks=asks)

    def newest(self, kind: type[M]) -> M | None:
        message = self.received.newest.get(kind)
        return message if isinstance(message, kind) else None

    def next(self, kind: type[M]) -> M:
        """Return the next message of that kind."""
        self.received.newest.pop(kind, None)
        self.until(lambda: kind in self.received.newest)
        message = self.newest(kind)
        assert message is not None
        return message

    def after(self, count: int, kind: type[Message] = CurrentCommand) -> None:
        """Let periods pass until `count` more messages of that kind were received."""
        wanted = self.received.counts[kind] + count
        self.until(lambda: self.received.counts[kind] >= wanted)

    def mode(self) -> Mode | None:
        status = self.newest(PositionerStatus)
        return status.mode if status else None

    def arm(self) -> None:
        """Send requests to arm until the positioner is ACTIVE."""
        self.received.newest.clear()
        steps = itertools.count()

        def is_active() -> bool:
            # a request counts when it changes
            self.request = HostRequest.ARM if next(steps) // 10 % 2 else HostRequest.NONE
            return self.mode() is Mode.ACTIVE

        self.until(is_active)

    def is_at(self, position_m: float, within_m: float = NEAR_M) -> bool:
        """Return whether the true position of the stem is there."""
        truth = self.newest(PlantTruth)
        return truth is not None and abs(truth.position_m - position_m) < within_m

    def go_to(self, position_m: float, within_m: float = NEAR_M) -> None:
        """Send the setpoint `position_m` until the stem rests there; arm a positioner that failed safe again."""
        self.setpoint_m = position_m
        rests = itertools.count()

        def is_there() -> bool:
            nonlocal rests
            if self.mode() is Mode.FAILSAFE:
                self.arm()
            if not self.is_at(position_m, within_m):
                rests = itertools.count()
            return next(rests) >= 10

        self.until(is_there)

    def pause(self, child: BenchProcess) -> None:
        child.process.send_signal(signal.SIGSTOP)

    def resume(self, child: BenchProcess) -> None:
        child.process.send_signal(signal.SIGCONT)

    def story(self) -> str:
        """Return the last messages and log lines, for the message of a failed test."""
        seen = {kind.__name__: str(message) for kind, message in self.received.newest.items()}
        plant = (self.folder / "plant.log").read_text(encoding="utf-8").splitlines()
        return "\n".join([str(seen), str(self.received.counts), *self.lines[-15:], *plant[-3:]])

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for child in (self.daemon, self.plant):
            if child.process.poll() is None:
                child.process.send_signal(signal.SIGCONT)
            child.stop()
        self.port.close()
