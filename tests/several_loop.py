"""One daemon in this process, several emulated valves in memory.

In lockstep each plant waits for its own commands; otherwise each sends at its period, in a virtual time.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Self

import can
import tomli_w
from still_clock import StillClock

from plant_emulator.device import advance, initial_device, publish, take
from plant_emulator.presets import plant_settings
from positioner.bus.port import Ports
from positioner.config.reader import load_valves
from positioner.machine.journal import logger
from positioner.runtime.daemon import Daemon
from positioner.runtime.session import RunOptions
from positioner.wire.codec import Codec, make_codec
from positioner.wire.messages import CanFrame, CurrentCommand, Message, Setpoint
from positioner.wire.settings import WireSettings

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path
    from types import TracebackType

    from positioner.bus.address import BusAddress
    from positioner.errors import ExitCode

PERIOD_S = 0.001
PERIOD_NS = 1_000_000
_EVERY = 10
_SETPOINTS_M = (0.08, 0.087, 0.073)
_DWELL = 150
_NS = 1_000_000_000
BUS, OTHER_BUS = "one", "two"


class VirtualTime(StillClock):
    """Time passes only where the loop waits; meanwhile each of the `ticks` happens every period, one after another."""

    def __init__(self) -> None:
        super().__init__()
        self.ticks: list[Callable[[], None]] = []
        self._tick_ns = self.now_ns
        self._ticked = 0

    def sleep(self, duration_s: float, queue: Sequence[object] = ()) -> None:
        """Let time pass, until something is in the `queue`."""
        end_ns = self.now_ns + round(duration_s * _NS)
        while not queue and self.ticks and self._tick_ns <= end_ns:
            self.now_ns = max(self.now_ns, self._tick_ns)
            self.ticks[self._ticked % len(self.ticks)]()
            self._ticked += 1
            self._tick_ns += PERIOD_NS // len(self.ticks)
        if not queue:
            self.now_ns = end_ns


class MemoryBus:
    """What python-can's bus is to a port: a queue. Frames sent on it go to the plants."""

    def __init__(self, time: VirtualTime) -> None:
        self.time = time
        self.queue: list[CanFrame] = []
        self.plants: list[Plant] = []
        self.is_cut = False

    def recv(self, timeout: float | None) -> can.Message | None:
        if self.is_cut:
            raise can.CanOperationError("Network is down", 100)
        if not self.queue:
            self.time.sleep(timeout or 0.0, self.queue)
        if not self.queue:
            return None
        frame = self.queue.pop(0)
        return can.Message(
            timestamp=frame.received_ns / _NS,
            arbitration_id=frame.arbitration_id,
            data=frame.data,
            is_extended_id=False,
        )

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        del timeout
        if self.is_cut:
            raise can.CanOperationError("Network is down", 100)
        for plant in self.plants:
            plant.take(CanFrame(message.arbitration_id, bytes(message.data)))

    def shutdown(self) -> None:
        pass


@dataclass
class Plant:
    """An emulated valve and its host. `sent` holds all frames that the positioner sent to them, `sent_ns` the instants.

    is_silent: its sensor is lost: it sends no position any more.
    """

    codec: Codec
    bus: MemoryBus
    seed: int
    waits: bool
    sample: int = 0
    is_silent: bool = False
    sent: list[CanFrame] = field(default_factory=list)
    sent_ns: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.settings = plant_settings()
        self.device = initial_device(self.settings, self.seed)

    def tick(self) -> None:
        """Let a period pass, and send the next reading."""
        self.device = advance(self.settings, self.device, PERIOD_S)
        if not self.is_silent:
            self.publish()

    def publish(self) -> None:
        """Send the next reading, and each tenth time a setpoint before it."""
        before = len(self.bus.queue)
        if self.sample % _EVERY == 0:
            setpoint_m = _SETPOINTS_M[self.sample // _DWELL % len(_SETPOINTS_M)]
            self.bus.queue.append(self.codec.encode(Setpoint(setpoint_m), self.sample // _EVERY))
        self.sample += 1
        self.device, published = publish(self.codec, self.settings, self.device)
        self.bus.queue += published
        self.bus.queue[before:] = [
            replace(frame, received_ns=self.bus.time.now_ns) for frame in self.bus.queue[before:]
        ]

    def take(self, frame: CanFrame) -> None:
        """Take a frame of the positioner; a command makes a period pass and brings the next reading."""
        if frame.identifier not in self.codec.by_id:
            return
        self.sent.append(frame)
        self.sent_ns.append(self.bus.time.now_ns)
        self.device = take(self.codec, self.device, (frame,))
        if self.waits and isinstance(self.codec.decode(frame)[0], CurrentCommand):
            self.tick()

    def messages(self) -> list[Message]:
        return [self.codec.decode(frame)[0] for frame in self.sent]


class SeveralLoop:
    """The daemon, whose valves are named; `on_other_bus` are those of them that are on a second bus."""

    def __init__(
        self,
        folder: Path,
        names: Sequence[str],
        on_other_bus: Sequence[str] = (),
        *,
        lockstep: bool = True,
        record: Path | None = None,
        control: dict[str, Any] | None = None,
    ) -> None:
        self.folder = folder
        self.time = VirtualTime()
        self.buses = {BUS: MemoryBus(self.time), OTHER_BUS: MemoryBus(self.time)}
        self.plants = {}
        valves = []
        for name in names:
            offset = 0x80 * (int(name[-1]) - 1)
            channel = OTHER_BUS if name in on_other_bus else BUS
            codec = make_codec(WireSettings(id_offset=offset))
            self.plants[name] = Plant(codec, self.buses[channel], seed=int(name[-1]), waits=lockstep)
            self.buses[channel].plants.append(self.plants[name])
            valves.append({"id": name, "preset": "paper", "wire": {"id_offset": offset}, "bus": {"channel": channel}})
        tables = {
            "bus": {"interface": "virtual"},
            "control": {"sample_period_s": PERIOD_S, **(control or {})},
            "guard": {"auto_arm": True},
            "state": {"directory": "state"},
            "valve": valves,
        }
        folder.mkdir(exist_ok=True)
        path = folder / "plant.toml"
        path.write_text(tomli_w.dumps(tables), encoding="utf-8")
        self.lines: list[str] = []
        self._handler = logging.Handler()
        self.logged_ns: list[int] = []
        self._handler.emit = self._keep  # type: ignore[method-assign]
        logger.addHandler(self._handler)
        options = RunOptions(lockstep=lockstep, setpoint_every=_EVERY if lockstep else 0, record=record)
        try:
            self.daemon = Daemon(load_valves(path), options, Ports(self.time, self._open))
        except BaseException:
            logger.removeHandler(self._handler)
            raise
        self.sessions = dict(zip(names, self.daemon.sessions, strict=True))
        self.code: ExitCode | None = None

    def _keep(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())
        self.logged_ns.append(self.time.now_ns)

    def _open(self, address: BusAddress, _wanted: Iterable[tuple[int, bool]]) -> Any:
        if self.buses[address.channel].is_cut:
            raise OSError(19, "No such device")
        return self.buses[address.channel]

    def start(self) -> None:
        for plant in self.plants.values():
            if plant.waits:
                plant.publish()
            else:
                self.time.ticks.append(plant.tick)

    def run_to(self, sample: int, *names: str) -> None:
        """Let the named plants, or all, come to that sample."""
        plants = [self.plants[name] for name in names or self.plants]
        for _ in range(100 * sample):
            if all(plant.sample >= sample for plant in plants):
                return
            self.daemon._cycle()
        raise AssertionError(self.lines)

    def logged(self, word: str) -> list[str]:
        return [line for line in self.lines if word in line]

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.code = self.daemon._close()
        logger.removeHandler(self._handler)
