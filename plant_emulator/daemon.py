"""The emulator's loop: its valve on a bus, in lockstep with a positioner or in real time. Shell."""

from __future__ import annotations

import math
import signal
import sys
import time
from functools import partial
from typing import TYPE_CHECKING

from plant_emulator.device import advance, failure, initial_device, publish, take
from plant_emulator.schedule import begun
from positioner.bus.port import BusPort
from positioner.errors import BenchError, ExitCode
from positioner.machine.line_sink import LineSink
from positioner.machine.notify import Notifier
from positioner.values import dataclass, replace
from positioner.wire.e2e import CounterCheck
from positioner.wire.messages import CurrentCommand, Setpoint, StemPosition

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from types import FrameType

    from plant_emulator.device import DeviceState
    from plant_emulator.parameters import PlantSettings
    from positioner.bus.address import BusAddress
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

_WAIT_S = 0.1
_STALL_S = 30.0
_AGAIN_S = 2.0
"""In lockstep a reading that nobody answers is sent again so often: the positioner may start after the emulator."""
_NS = 1_000_000_000
_LATEST_PERIODS = 4
"""Where the emulator was kept waiting, a reading later than this is not sent: a sensor node sends no old ones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatorOptions:
    """The options of a run.

    seed: of the noise and of the stochastic friction.
    lockstep: wait for the command before the next period; otherwise the clock sets the pace.
    setpoint_every: in lockstep, also wait for a setpoint frame every so many samples; 0 for never. In real time, if it
        is not 0, the first sample is half a period after the first setpoint.
    command_delay_s: commands act this long after a reading, up to a period; 0 for as soon as they arrive.
    """

    bus: BusAddress
    period_s: float
    seed: int
    lockstep: bool
    setpoint_every: int = 0
    command_delay_s: float = 0.0


class EmulatorDaemon:
    """One emulated valve on one bus."""

    def __init__(self, settings: PlantSettings, codec: Codec, options: EmulatorOptions) -> None:
        """Make the valve; the bus is opened by `run`."""
        self._settings = settings
        self._codec = codec
        self._options = options
        self._stopping = False
        position = codec.by_kind[StemPosition]
        has_echo = position.counter is not None and codec.carries(CurrentCommand, "position_counter")
        self._echo_modulus = position.counter_modulus if has_echo else 0
        identifiers = [codec.identifier(kind) for kind in (CurrentCommand, Setpoint)]
        self._log = LineSink.of(sys.stderr)
        self._bus = BusPort(options.bus, identifiers, lambda event: self._report(str(event)))
        self._notifier = Notifier()
        self._state = initial_device(settings, options.seed)
        self._failure = ""
        self._start_ns = 0
        self._waiting: list[CanFrame] = []
        self._published: tuple[CanFrame, ...] = ()

    def run(self) -> ExitCode:
        """Run until SIGTERM or SIGINT.

        Raises:
            BenchError: nobody answers in lockstep, or the setpoint to wait for does not come.
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
        """Advance one period as soon as the setpoint and the command that belong to it have come."""
        every, delay_s = self._options.setpoint_every, self._options.command_delay_s
        while not self._stopping:
            sample = self._state.position_counter
            if every and sample % every == 0:
                self._await(partial(_has_setpoint, number=sample // every), "setpoint frame")
            known = self._state.commands
            self._publish()
            if delay_s:
                self._advance(delay_s)
            is_answered = partial(_is_answered, sample=sample, modulus=self._echo_modulus, known=known)
            self._await(is_answered, "command frame")
            if not self._stopping:
                self._advance(self._options.period_s - delay_s)

    def _await(self, arrived: Callable[[DeviceState], bool], frame_name: str) -> None:
        """Take frames until what is waited for `arrived`: `_STALL_S` at most in a bench, or else until there is one."""
        began_s = time.monotonic()
        deadline_s, again_s = began_s + _STALL_S, began_s + _AGAIN_S
        while not arrived(self._state) and not self._stopping:
            frames = self._bus.receive(_WAIT_S)
            self._state = take(self._codec, self._state, frames)
            now_s, sample = time.monotonic(), self._state.position_counter
            if self._options.setpoint_every:
                if not frames and now_s > deadline_s:
                    text = f"it waits at sample {sample}: no {frame_name} within {_STALL_S:g} s"
                    raise BenchError(f"{text}; is the positioner armed (guard.auto_arm), in lockstep, and on this bus?")
            elif now_s > again_s:
                if again_s == began_s + _AGAIN_S:
                    self._report(f"waits at sample {sample} for a {frame_name} of a positioner in lockstep")
                again_s = now_s + _AGAIN_S
                # whoever answers now is a new positioner, whose counter does not go on from the last one's
                self._state = replace(self._state, command_check=CounterCheck())
                self._send(self._published)

    def _run_real_time(self) -> None:
        """Publish every period, with or without commands; what is too late is lost, but never in a bench."""
        period_ns, delay_ns = round(self._options.period_s * _NS), round(self._options.command_delay_s * _NS)
        if self._options.setpoint_every:
            self._await(partial(_has_setpoint, number=0), "setpoint frame")
            self._wait_until(time.monotonic_ns() + period_ns // 2)
        self._start_ns = begin_ns = time.monotonic_ns()
        latest_ns = math.inf if self._options.setpoint_every else _LATEST_PERIODS * period_ns
        while not self._stopping:
            if time.monotonic_ns() - begin_ns <= latest_ns:
                self._publish()
            else:
                self._state = replace(self._state, position_counter=self._state.position_counter + 1)
            if delay_ns:
                self._act_together(begin_ns + delay_ns, begin_ns + period_ns)
            else:
                self._act_on_arrival(begin_ns + period_ns)
            begin_ns += period_ns

    def _act_on_arrival(self, end_ns: int) -> None:
        """Advance to `end_ns`; a command acts from the instant at which it arrives."""
        while not self._stopping and (left_ns := end_ns - time.monotonic_ns()) > 0:
            for frame in self._bus.receive(left_ns / _NS):
                self._advance_to(min(frame.received_ns, end_ns))
                self._state = take(self._codec, self._state, (frame,))
        self._advance_to(end_ns)

    def _act_together(self, at_ns: int, end_ns: int) -> None:
        """Advance to `end_ns`; the commands that have arrived by `at_ns` act from then on, as in a node with a timer.

        The valve is computed while its node waits: nothing else acts meanwhile.
        """
        self._advance_to(at_ns)
        self._wait_until(at_ns)
        arrived = tuple(frame for frame in self._waiting if frame.received_ns <= at_ns)
        self._waiting = [frame for frame in self._waiting if frame.received_ns > at_ns]
        self._state = take(self._codec, self._state, arrived)
        self._advance_to(end_ns)
        self._wait_until(end_ns)

    def _wait_until(self, end_ns: int) -> None:
        """Receive until `end_ns`, at least once: frames may have waited while this process did not run."""
        self._waiting += self._bus.receive(max(end_ns - time.monotonic_ns(), 0) / _NS)
        while not self._stopping and (left_ns := end_ns - time.monotonic_ns()) > 0:
            self._waiting += self._bus.receive(left_ns / _NS)

    def _advance_to(self, instant_ns: int) -> None:
        duration_s = (instant_ns - self._start_ns) / _NS - self._state.plant.time_s
        if duration_s > 0.0:
            self._advance(duration_s)

    def _advance(self, duration_s: float) -> None:
        """Advance the valve; report a scheduled change, a way to the fail position, and when the valve obeys again."""
        if self._settings.schedule:
            now_s = self._state.plant.time_s
            for line in begun(self._settings, now_s, now_s + duration_s):
                self._report(line)
        self._state = advance(self._settings, self._state, duration_s)
        text = failure(self._settings, self._state)
        if text != self._failure:
            self._failure = text
            line = text or "a valid command: the valve obeys again"
            self._report(line)
            self._notifier.send(STATUS=line)

    def _publish(self) -> None:
        self._state, self._published = publish(self._codec, self._settings, self._state)
        self._send(self._published)

    def _send(self, frames: Iterable[CanFrame]) -> None:
        for frame in frames:
            self._bus.send(frame)

    def _report(self, line: str) -> None:
        self._log.write(f"plant-emulator: {line}")

    def _stop(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._stopping = True


def _has_setpoint(state: DeviceState, *, number: int) -> bool:
    return state.setpoints > number


def _is_answered(state: DeviceState, *, sample: int, modulus: int, known: int) -> bool:
    """Return whether a command answers `sample`: by its echo, or after the `known` ones where frames carry none."""
    return state.answered == sample % modulus if modulus else state.commands > known
