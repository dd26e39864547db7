"""The emulator's loop: its valve on a bus, in lockstep with a positioner or in real time. Shell."""

from __future__ import annotations

import signal
import sys
import time
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from plant_emulator.device import advance, failure, initial_device, publish, take
from positioner.bus.port import BusPort
from positioner.errors import BenchError, ExitCode
from positioner.machine.line_sink import LineSink
from positioner.machine.notify import Notifier
from positioner.wire.e2e import COUNTER_MODULUS
from positioner.wire.messages import CurrentCommand, Setpoint

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

    from plant_emulator.device import DeviceState
    from plant_emulator.parameters import PlantSettings
    from positioner.bus.address import BusAddress
    from positioner.wire.codec import Codec

_WAIT_S = 0.1
_STALL_S = 30.0
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatorOptions:
    """How the emulator runs: its bus, its period, its noise, and who sets the pace.

    setpoint_every: in lockstep, samples between two setpoint frames that are waited for; 0 waits for none.
    """

    bus: BusAddress
    period_s: float
    seed: int
    lockstep: bool
    setpoint_every: int = 0


class EmulatorDaemon:
    """One emulated valve on one bus."""

    def __init__(self, settings: PlantSettings, codec: Codec, options: EmulatorOptions) -> None:
        """Make the valve; the bus is opened by `run`."""
        self._settings = settings
        self._codec = codec
        self._options = options
        self._stopping = False
        identifiers = [codec.identifier(kind) for kind in (CurrentCommand, Setpoint)]
        self._log = LineSink.of(sys.stderr)
        self._bus = BusPort(options.bus, identifiers, lambda event: self._say(str(event)))
        self._notifier = Notifier()
        self._state = initial_device(settings, options.seed)
        self._told = ""

    def run(self) -> ExitCode:
        """Run until SIGTERM or SIGINT.

        Raises:
            BenchError: in lockstep, nobody answers.
        """
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._stop)
        while not self._bus.is_open and not self._stopping:
            self._bus.receive(_WAIT_S)
        self._notifier.send(READY="1", STATUS=f"valve on {self._options.bus}")
        try:
            if self._options.lockstep:
                self._run_lockstep()
            else:
                self._run_real_time()
        finally:
            self._bus.close()
            self._notifier.close()
        return ExitCode.OK

    def _run_lockstep(self) -> None:
        """Advance one period when the host and the positioner have said what belongs to it."""
        every = self._options.setpoint_every
        while not self._stopping:
            sample = self._state.position_counter
            if every and sample % every == 0:
                self._await(partial(_has_setpoint, number=sample // every), "setpoint frame")
            self._publish()
            self._await(partial(_is_answered, sample=sample), "command frame")
            if not self._stopping:
                self._advance(self._options.period_s)

    def _await(self, arrived: Callable[[DeviceState], bool], what: str) -> None:
        deadline_s = time.monotonic() + _STALL_S
        while not arrived(self._state) and not self._stopping:
            frames = self._bus.receive(_WAIT_S)
            self._state = take(self._codec, self._state, frames)
            if not frames and time.monotonic() > deadline_s:
                sample = self._state.position_counter
                told = f"lockstep stands still at sample {sample}: no {what} within {_STALL_S:g} s"
                raise BenchError(f"{told}; is the positioner armed (guard.auto_arm), in lockstep, and on this bus?")

    def _run_real_time(self) -> None:
        """Publish once a period whatever comes back; a command counts from the instant it arrives."""
        period_ns = round(self._options.period_s * _NS)
        start_ns = time.monotonic_ns()
        sample = 0
        while not self._stopping:
            self._publish()
            sample += 1
            self._live_until(start_ns, start_ns + sample * period_ns)

    def _live_until(self, start_ns: int, end_ns: int) -> None:
        while not self._stopping and (left_ns := end_ns - time.monotonic_ns()) > 0:
            for frame in self._bus.receive(left_ns / _NS):
                self._advance_to(min(frame.received_ns, end_ns) - start_ns)
                self._state = take(self._codec, self._state, (frame,))
        self._advance_to(end_ns - start_ns)

    def _advance_to(self, plant_ns: int) -> None:
        duration_s = plant_ns / _NS - self._state.plant.time_s
        if duration_s > 0.0:
            self._advance(duration_s)

    def _advance(self, duration_s: float) -> None:
        """Let the valve live on, and say so when it begins or ceases to fail safe by itself."""
        self._state = advance(self._settings, self._state, duration_s)
        told = failure(self._settings, self._state)
        if told != self._told:
            self._told = told
            line = told or "a valid command: the valve obeys again"
            self._say(line)
            self._notifier.send(STATUS=line)

    def _publish(self) -> None:
        self._state, frames = publish(self._codec, self._settings, self._state)
        for frame in frames:
            self._bus.send(frame)

    def _say(self, line: str) -> None:
        self._log.write(f"plant-emulator: {line}")

    def _stop(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._stopping = True


def _has_setpoint(state: DeviceState, *, number: int) -> bool:
    return state.setpoints > number


def _is_answered(state: DeviceState, *, sample: int) -> bool:
    return state.answered == sample % COUNTER_MODULUS
