"""The host of a bench: it sends a scenario's setpoints as frames and records all frames of the bus. Shell."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, NoReturn

from tqdm import tqdm

from positioner.bench.machine_load import MachineLoad
from positioner.bench.scenario import MOST_SAMPLES_PER_SETPOINT
from positioner.errors import BenchError
from positioner.wire.messages import Setpoint

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from positioner.bench.recording import Recording
    from positioner.bench.scenario import Scenario
    from positioner.bench.timing import Second
    from positioner.bus.port import BusPort
    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

_NS = 1_000_000_000
_TIMEOUT_S = 30.0
_CHECK_AFTER_S = 0.25
_PAUSE_S = 0.002
_LAST_ANSWER_S = 0.01
"""In real time the last sample and its answer come a little later than the last setpoint's period ends."""


class Host:
    """Plays one scenario on one bus: sends its setpoints, and records every frame."""

    def __init__(
        self, scenario: Scenario, codec: Codec, bus: BusPort, recording: Recording, check: Callable[[], None]
    ) -> None:
        """Prepare; `check` raises a BenchError when a process of the bench has ended."""
        self._scenario = scenario
        self._codec = codec
        self._bus = bus
        self._recording = recording
        self._check = check
        self._sent = 0
        self._start_ns = time.monotonic_ns()

    def play_lockstep(self) -> None:
        """Send the setpoints as far ahead as the sockets have room, and receive; plant and daemon set the pace.

        Raises:
            BenchError: no frame comes for a long time, or the bus lost a frame.
        """
        every, samples = self._scenario.samples_per_setpoint, self._recording.samples
        ahead = max(MOST_SAMPLES_PER_SETPOINT // every, 1) * every
        received_s, known, due = time.monotonic(), 0, 0
        with self._progress() as bar:
            while known < samples:
                for sample in range(due, min(known // every * every + ahead, samples), every):
                    self._send_setpoint(sample)
                    due = sample + every
                time.sleep(_PAUSE_S)  # waking for each frame would take processor time from plant and daemon
                if self._receive(0.0):
                    received_s = time.monotonic()
                elif time.monotonic() - received_s > _CHECK_AFTER_S:
                    self._check()
                    if time.monotonic() - received_s > _TIMEOUT_S:
                        raise BenchError(
                            f"no answer to sample {known} on {self._bus.address}: see positioner.log; the positioner "
                            "does not answer a reading that it rejects, and in lockstep the plant waits for the answer"
                        )
                bar.update(self._recording.complete - known)
                known = self._recording.complete
        lost = self._recording.lost + self._recording.unanswered
        if lost:
            raise BenchError(f"the bus lost {lost} frame(s): this run is not reproducible: repeat it")

    def play_real_time(self, pids: Iterable[int]) -> tuple[Second, ...]:
        """Return the seconds of the run; `pids` are the processes of the bench beside this one.

        It sends a setpoint every period of its clock, and then receives what has come since the last one: the kernel
        has stamped it, and a host that woke for each frame would take a processor from the loop. The emulator's first
        sample comes half a period after the first setpoint; so does each dwell's, as in lockstep.

        Raises:
            BenchError: a process of the bench has ended.
        """
        every, period_s = self._scenario.samples_per_setpoint, self._scenario.sample_period_s
        load = MachineLoad(time.monotonic_ns(), pids)
        with self._progress() as bar:
            self._send_setpoint(0)
            self._start_ns = self._recording.begin_ns = time.monotonic_ns()
            for sample in range(every, self._recording.samples, every):
                self._sleep_until(sample * period_s)
                self._send_setpoint(sample)
                self._receive(0.0)
                self._check()
                load.look(time.monotonic_ns())
                bar.update(every)
            self._sleep_until(self._recording.samples * period_s + _LAST_ANSWER_S)
            self._receive(0.0)
        return tuple(load.seconds)

    def _sleep_until(self, time_s: float) -> None:
        """Sleep until `time_s` after the start."""
        time.sleep(max(self._start_ns + round(time_s * _NS) - time.monotonic_ns(), 0) / _NS)

    def _send_setpoint(self, sample: int) -> None:
        scenario = self._scenario
        setpoint_m = scenario.setpoint_m_at(sample)
        self._recording.setpoint_m[sample : sample + scenario.samples_per_setpoint] = setpoint_m
        frame = self._codec.encode(Setpoint(setpoint_m), self._sent)
        self._sent += 1
        self._record(frame, time.monotonic_ns())
        if not self._bus.send(frame):
            raise BenchError(f"bus {self._bus.address} did not accept a setpoint frame")

    def _receive(self, timeout_s: float) -> bool:
        frames = self._bus.receive(timeout_s)
        for frame in frames:
            self._record(frame, frame.received_ns)
        return bool(frames)

    def _record(self, frame: CanFrame, received_ns: int) -> None:
        self._recording.add(frame, (received_ns - self._start_ns) / _NS)

    def _progress(self) -> tqdm[NoReturn]:
        seconds = self._scenario.duration_s
        return tqdm(
            total=self._recording.samples,
            desc=f"{self._scenario.name}, {seconds:g} s",
            unit=" samples",
            mininterval=0.2,
            leave=False,
            disable=None,
        )
