"""From a position frame on its way to the bus until its command has come back, with the daemon at the other end.

The daemon runs in lockstep, so its commands are those of the recorded run, however long a frame takes. The frames come
with pauses, as on hardware: each finds the daemon asleep.
"""

from __future__ import annotations

import hashlib
import os
import socket
import tempfile
import time
from pathlib import Path
from time import perf_counter_ns
from typing import TYPE_CHECKING

from benchmarks import machine
from benchmarks.bus_process import WAITING
from benchmarks.case import Play
from benchmarks.cycles import record
from benchmarks.paired_bus import PairedBus
from positioner.bench.configure import configuration_text
from positioner.bench.inprocess import configure
from positioner.bench.processes import BenchProcess
from positioner.bus.address import BusAddress, embedded_address
from positioner.bus.port import BusPort, Ports
from positioner.wire.messages import CurrentCommand, PlantTruth, StemPosition

if TYPE_CHECKING:
    from positioner.bench.scenario import Scenario
    from positioner.wire.messages import CanFrame

_PAUSE_S = 3e-4
_ANSWER_S = 30.0


class BusCase:
    """All cycles of a run over a bus; `kind` is daemon or echo."""

    def __init__(self, wanted: Scenario, kind: str, *, paired: bool) -> None:
        configuration = configure(wanted)
        codec = configuration.make_codec()
        self._kind, self._paired, self._wanted = kind, paired, wanted
        self._position, self._command = codec.identifier(StemPosition), codec.identifier(CurrentCommand)
        unseen = codec.identifier(PlantTruth)
        cycles = list(record(wanted, configuration))
        self._batches = [[f for f in cycle.cycle_input.frames if f.identifier != unseen] for cycle in cycles]
        answers = [frame for cycle in cycles for frame in cycle.outbox if frame.identifier == self._command]
        self._answered = [any(frame.identifier == self._command for frame in cycle.outbox) for cycle in cycles]
        self._result = _digest(answers)
        self.labels = tuple(cycle.label for cycle in cycles)

    def play(self) -> Play:
        """Return the durations of all cycles, and a digest of the commands.

        Raises:
            RuntimeError: no command came, or others than in the recorded run.
        """
        with tempfile.TemporaryDirectory(prefix="benchmark-") as folder:
            address = BusAddress() if self._paired else embedded_address(os.getpid())
            path = Path(folder) / "valve.toml"
            path.write_text(configuration_text(self._wanted, address, Path(folder) / "state"), encoding="utf-8")
            arguments = [self._kind, str(path), str(self._wanted.samples_per_setpoint)]
            listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            if self._paired:
                listener.bind(f"{folder}/bus")
                listener.listen(1)
                arguments.append(f"{folder}/bus")
            with listener, BenchProcess("benchmarks.bus_process", arguments, Path(folder) / "log") as process:
                machine.apart(process.process.pid)
                ports = Ports(open_bus=lambda _address, _wanted: PairedBus(listener.accept()[0]))
                port = BusPort(address, [self._command], ports=ports if self._paired else None)
                process.wait_for(WAITING)
                port.open()
                try:
                    return self._exchange(port)
                finally:
                    port.close()

    def _exchange(self, port: BusPort) -> Play:
        durations_ns: list[int] = []
        answers: list[CanFrame] = []
        for (*others, position), answered in zip(self._batches, self._answered, strict=True):
            for frame in others:
                port.send(frame)
            time.sleep(_PAUSE_S)
            began = perf_counter_ns()
            port.send(position)
            if answered or self._kind == "echo":
                frames = port.receive(_ANSWER_S)
                durations_ns.append(perf_counter_ns() - began)
                if not frames:
                    raise RuntimeError("no command came back over the bus")
                answers += frames
            else:
                durations_ns.append(0)
        result = _digest(answers)
        if self._kind == "daemon" and result != self._result:
            raise RuntimeError("the daemon sent other commands over the bus than the recorded cycles")
        return Play(durations_ns, result)


def _digest(frames: list[CanFrame]) -> str:
    return hashlib.sha256(b"".join(frame.data for frame in frames)).hexdigest()
