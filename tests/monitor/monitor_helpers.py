"""A valve's frames, a bus that brings them and keeps what is sent on it, and what a terminal shows."""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import can
from still_clock import StillClock

from positioner.bus.port import Ports
from positioner.config.reader import load_valves
from positioner.monitor.live import LiveSource
from positioner.wire.messages import (
    CanFrame,
    Cause,
    Counted,
    CurrentCommand,
    Health,
    Mode,
    Motion,
    PositionerCount,
    PositionerStatus,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from textual.app import App

    from positioner.config.schema import Configuration
    from positioner.wire.codec import Codec

PERIOD_NS = 10_000_000
ONE = '[valve]\nid = "FV-101"\npreset = "paper"\n[control]\nsample_period_s = 0.01\n[bus]\ninterface = "virtual"\n'
TWO = """\
[control]
sample_period_s = 0.01
[bus]
interface = "virtual"
[[valve]]
id = "FV-101"
preset = "paper"
[[valve]]
id = "FV-102"
preset = "paper"
[valve.wire]
id_offset = 128
"""


def configured(folder: Path, text: str = ONE) -> tuple[Configuration, ...]:
    """Return the valves of a configuration, which is written into the folder."""
    path = folder / "valve.toml"
    path.write_text(text, encoding="utf-8")
    return load_valves(path)


def frames_of(codec: Codec, seconds: float, begin_ns: int = 0) -> Iterator[CanFrame]:
    """Yield the frames of a valve that follows a setpoint of 62 mm at 100 Hz, and slips by 4 mm each second."""
    for sample in range(round(seconds * 1e9) // PERIOD_NS):
        now_ns = begin_ns + sample * PERIOD_NS
        position_m = 0.060 + 0.004 * (sample // 100 % 2)
        command = CurrentCommand(12.0, sample % 256, sample % 256, Mode.ACTIVE, Motion.REST)
        messages: list[Any] = [Setpoint(0.062), StemPosition(position_m, sample % 256), command]
        frames = [codec.encode(message, sample) for message in messages]
        if sample % 10 == 0:
            status = PositionerStatus(Mode.ACTIVE, Cause.NONE, Health.GOOD, True, True, 3, 2, 42)
            count = PositionerCount(Counted.LOST, 5)
            frames += [codec.encode(status, sample // 10), codec.encode(count, sample // 10)]
        for frame in frames:
            yield replace(frame, received_ns=now_ns)


class RecordingBus(StillClock):
    """A bus of python-can that brings what is put into it, and keeps all that is sent on it; and the clock of its node.

    The clock stands still but for `pass_time`, so a machine that is slow changes nothing.
    """

    def __init__(self) -> None:
        super().__init__()
        self.brought: queue.Queue[can.Message] = queue.Queue()
        self.sent: list[can.Message] = []
        self.is_cut = threading.Event()

    def sleep(self, duration_s: float) -> None:
        time.sleep(min(duration_s, 0.01))

    def open(self, _address: object, _wanted: object) -> Any:
        if self.is_cut.is_set():
            raise OSError(19, "No such device")
        return self

    def bring(self, frames: Iterable[CanFrame]) -> None:
        for frame in frames:
            self.brought.put(can.Message(arbitration_id=frame.arbitration_id, data=frame.data, is_extended_id=False))

    def recv(self, timeout: float | None) -> can.Message | None:
        if self.is_cut.is_set():
            raise can.CanOperationError("Network is down", 100)
        try:
            return self.brought.get(timeout=timeout) if timeout else self.brought.get_nowait()
        except queue.Empty:
            return None

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        del timeout
        self.sent.append(message)

    def shutdown(self) -> None:
        pass


def live_source(configurations: tuple[Configuration, ...], bus: RecordingBus) -> LiveSource:
    """Return the valves of a configuration on this bus."""
    return LiveSource(configurations, {}, Ports(bus, bus.open))


def shown(app: App[Any]) -> str:
    """Return what a terminal shows."""
    return "\n".join(strip.text for strip in app.screen._compositor.render_strips())
