"""How many valves one core controls at 1 kHz: the share of a core that each valve of one daemon takes.

The daemon's own loop runs in this process, with n sessions on buses that are pairs of local sockets, up to eleven on
one. Only its part is timed, in processor time, from a look at the bus until its commands are sent; the emulated valves
run between. The frames of a period come one after another, as on a real bus, so that each takes a round of its own. The
setpoints change four times a second, at another instant for each valve. No table writer runs: it is another process.
"""

from __future__ import annotations

import socket
import tempfile
from pathlib import Path
from time import thread_time_ns
from typing import TYPE_CHECKING, Any
from unittest import mock

import tomli_w
from still_clock import StillClock

from benchmarks.case import Play
from benchmarks.paired_bus import PairedBus
from plant_emulator.device import advance, initial_device, publish, take
from plant_emulator.presets import plant_settings
from positioner.bus import frame_socket
from positioner.bus import port as port_module
from positioner.bus.frame_socket import FrameSocket
from positioner.bus.port import BusPort, Ports
from positioner.config.reader import load_valves
from positioner.runtime.daemon import Daemon
from positioner.runtime.session import RunOptions
from positioner.store.client import TableWriterClient
from positioner.store.health_client import HealthClient
from positioner.store.health_messages import NO_HEALTH
from positioner.valve.stiction import StictionTable
from positioner.wire.codec import make_codec
from positioner.wire.messages import PlantTruth, Setpoint
from positioner.wire.settings import ID_OFFSETS, WireSettings

if TYPE_CHECKING:
    from collections.abc import Sequence

    import can

    from positioner.bus.port import OpenBus
    from positioner.config.schema import Configuration
    from positioner.wire.messages import CanFrame

COUNTS = (1, 2, 4, 8, 16)
PERIOD_NS = 1_000_000
_PERIODS = 1000
_WARM_UP = 100
_SETPOINT_EVERY = 10
_DWELL = 250
_SETPOINTS_M = (0.08, 0.087, 0.073, 0.084, 0.076)
_PER_BUS = len(ID_OFFSETS)


class _Clock(StillClock):
    """The daemon's clock: the plants let its time pass."""

    def sleep(self, duration_s: float) -> None:
        self.pass_time(duration_s)


def _socket_of(bus: can.BusABC, _address: object) -> FrameSocket:
    """Return the link that a SocketCAN bus has: the pair's frames have the same form."""
    return FrameSocket(bus, frame_socket._from_can, frame_socket._to_can)


class _NoWriter:
    """In the place of the daemon's side of a table writer."""

    def __init__(self) -> None:
        self.problem = None
        self.health = HealthClient(NO_HEALTH)

    def record(self, samples: Sequence[object]) -> None:
        pass

    def keep_health(self, sections: dict[str, Any]) -> None:
        pass

    def poll(self) -> tuple[object, ...]:
        return ()

    def begin_close(self) -> None:
        pass

    def close(self, timeout_s: float) -> None:
        pass


class _Valve:
    """An emulated valve with its host; each valve changes its setpoints at other samples."""

    def __init__(self, number: int, count: int, far: BusPort) -> None:
        self._codec = make_codec(WireSettings(id_offset=ID_OFFSETS[number % _PER_BUS]))
        self._plant = plant_settings()
        self._device = initial_device(self._plant, number + 1)
        self._far = far
        self._sample = number * _DWELL // count
        self._setpoints = 0

    def send(self) -> None:
        """Send the frames of a sample."""
        if self._setpoints == 0 or self._sample % _SETPOINT_EVERY == 0:
            setpoint_m = _SETPOINTS_M[self._sample // _DWELL % len(_SETPOINTS_M)]
            self._far.send(self._codec.encode(Setpoint(setpoint_m), self._setpoints))
            self._setpoints += 1
        self._sample += 1
        self._device, published = publish(self._codec, self._plant, self._device)
        truth = self._codec.identifier(PlantTruth)
        for frame in published:
            if frame.identifier != truth:  # no positioner receives it
                self._far.send(frame)

    def advance(self, frames: Sequence[CanFrame]) -> None:
        """Let a period pass under the command among `frames`."""
        self._device = advance(self._plant, take(self._codec, self._device, tuple(frames)), PERIOD_NS / 1e9)


class ValvesCase:
    """A daemon with `count` valves for `_PERIODS` periods; the duration of a period is that of all rounds in it."""

    def __init__(self, count: int) -> None:
        self._count = count
        self.labels = ("period",) * _PERIODS

    def play(self) -> Play:
        """Return the durations of all periods, and all commands."""
        with tempfile.TemporaryDirectory(prefix="benchmark-") as folder:
            return self._play(Path(folder))

    def _play(self, folder: Path) -> Play:
        path = folder / "valves.toml"
        path.write_text(tomli_w.dumps(_tables(self._count, folder)), encoding="utf-8")
        clock = _Clock()
        far: dict[str, BusPort] = {}

        def open_bus(address: Any, _wanted: object) -> PairedBus:
            ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            far[address.channel] = BusPort(address, ports=Ports(clock, lambda *_: PairedBus(theirs)))
            far[address.channel].open()
            return PairedBus(ours)

        with mock.patch.object(port_module, "socket_of", _socket_of):
            return self._run(load_valves(path), clock, far, open_bus)

    def _run(
        self, configurations: Sequence[Configuration], clock: _Clock, far: dict[str, BusPort], open_bus: OpenBus
    ) -> Play:
        opened = (_NoWriter(), StictionTable(cell_width_m=configurations[0].control.table_cell_m), ())
        with mock.patch.object(TableWriterClient, "open", return_value=opened):
            daemon = Daemon(configurations, RunOptions(), Ports(clock, open_bus))
        for bus in daemon._shared:
            bus.port.open()
        ports = [far[configuration.bus.channel] for configuration in configurations]
        valves = [_Valve(number, self._count, port) for number, port in enumerate(ports)]
        durations_ns, sent = [], []
        for _ in range(_WARM_UP + _PERIODS):
            took_ns = 0
            for number, (valve, port) in enumerate(zip(valves, ports, strict=True)):
                clock.now_ns += PERIOD_NS * (number + 1) // self._count - PERIOD_NS * number // self._count
                valve.send()
                began = thread_time_ns()
                daemon._cycle()
                took_ns += thread_time_ns() - began
                frames = port.receive(0.0)
                sent.append(frames)
                valve.advance(frames)
            durations_ns.append(took_ns)
        daemon._close()
        for port in far.values():
            port.close()
        return Play(durations_ns[_WARM_UP:], repr([[frame.data for frame in frames] for frames in sent]))


def _tables(count: int, folder: Path) -> dict[str, Any]:
    valves = [
        {
            "id": f"V{number}",
            "preset": "paper",
            "wire": {"id_offset": ID_OFFSETS[number % _PER_BUS]},
            "bus": {"channel": f"bus{number // _PER_BUS}"},
        }
        for number in range(count)
    ]
    return {
        "bus": {"interface": "virtual"},
        "control": {"sample_period_s": PERIOD_NS / 1e9},
        "guard": {"auto_arm": True},
        "state": {"directory": str(folder)},
        "valve": valves,
    }
