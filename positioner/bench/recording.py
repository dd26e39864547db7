"""The frames that a bench received: arrays for the figures, and `bus.log`. Shell.

In lockstep every frame belongs to a sample. The log lists a sample's frames in the order of cause and effect (setpoint,
truth, reading, command, status), in whatever order the sockets of three processes deliver them. Its time is the
plant's, and two runs write the same bytes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from positioner.bench.columns import column
from positioner.bench.frame_log import write_frames
from positioner.bench.metrics import Trace
from positioner.bench.modes import ModeReport
from positioner.cycle.outbox import STATUS_PERIOD_NS
from positioner.wire.formats import FrameRejectedError
from positioner.wire.messages import (
    ActuatorState,
    CurrentCommand,
    Message,
    Mode,
    PlantTruth,
    PositionerAlarms,
    PositionerCount,
    PositionerStatus,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from positioner.wire.codec import Codec
    from positioner.wire.messages import CanFrame

_RANK = {
    kind: rank
    for rank, kind in enumerate(
        (
            *(Setpoint, ActuatorState, PlantTruth, StemPosition, CurrentCommand),
            *(PositionerStatus, PositionerCount, PositionerAlarms),
        )
    )
}
_COUNTER = 256


@dataclass(slots=True)
class Recording:
    """The samples of a run; `setpoints`, `truth`, `readings`, `commands` and `statuses` count the frames.

    `mode_reports` are the modes in the positioner's frames; of a loop without a bus, before `read_modes`, in its status
    alone. In real time `begin_ns` is the monotonic instant of the start.
    """

    codec: Codec
    samples: int
    period_s: float
    samples_per_setpoint: int
    lockstep: bool
    setpoints: int = 0
    truth: int = 0
    readings: int = 0
    commands: int = 0
    statuses: int = 0
    frames: list[tuple[float, int, CanFrame]] = field(default_factory=list)
    mode_reports: list[ModeReport] = field(default_factory=list)
    true_position_m: NDArray[np.float64] = field(init=False)
    true_velocity_m_per_s: NDArray[np.float64] = field(init=False)
    measured_m: NDArray[np.float64] = field(init=False)
    current_ma: NDArray[np.float64] = field(init=False)
    setpoint_m: NDArray[np.float64] = field(init=False)
    lost: int = 0
    unanswered: int = 0
    origin: int | None = None
    begin_ns: int = 0
    _rank_by_id: dict[int, int] = field(init=False)
    _counts: bool = field(init=False)
    _has_modes: bool = field(init=False)

    def __post_init__(self) -> None:
        """Make room for every sample."""
        for name in ("true_position_m", "true_velocity_m_per_s", "measured_m", "current_ma", "setpoint_m"):
            setattr(self, name, np.full(self.samples, np.nan))
        # a user's frames may lack counters and the mode: the truth, which is ours, counts them; the status has the mode
        kinds = (StemPosition, CurrentCommand)
        self._counts = all(self.codec.by_kind[kind].data_id is not None for kind in kinds)
        self._has_modes = self.codec.carries(CurrentCommand, "mode")
        named = [kind for kind in self._columns if self._has_modes or kind is not CurrentCommand]
        identifiers = [(self.codec.identifier(kind), _RANK[kind]) for kind in named]
        self._rank_by_id = {number | is_extended << 31: rank for (number, is_extended), rank in identifiers}
        if self.lockstep:  # the host is there before the first sample, and may receive its frames in any order
            self.origin = 0

    def add(self, frame: CanFrame, time_s: float) -> None:
        """Add a frame that arrived `time_s` after the start; in lockstep the time of its sample is used instead."""
        try:
            message, counter = self.codec.decode(frame)
        except FrameRejectedError:
            self.frames.append((time_s, len(_RANK), frame))
            return
        sample = self._sample_of(message, counter)
        stamp_s = sample * self.period_s if self.lockstep else time_s
        self.frames.append((stamp_s, _RANK.get(type(message), len(_RANK)), frame))
        is_inside = 0 <= sample < self.samples
        if isinstance(message, PlantTruth) and is_inside:
            self.true_position_m[sample] = message.position_m
            self.true_velocity_m_per_s[sample] = message.velocity_m_per_s
        elif isinstance(message, StemPosition) and is_inside:
            self.measured_m[sample] = message.position_m
        elif isinstance(message, CurrentCommand):
            if self._has_modes:
                self.mode_reports.append(ModeReport(stamp_s, message.mode))
            elif self.mode_reports:
                self.mode_reports.append(ModeReport(stamp_s, self.mode_reports[-1].mode))
            if is_inside:
                self.current_ma[sample] = message.current_ma
        elif isinstance(message, PositionerStatus):
            self.mode_reports.append(ModeReport(stamp_s, message.mode, message.cause))

    def add_sample(self, sample: int, frames: Iterable[CanFrame]) -> None:
        """Add the frames of one sample of a loop without a bus, where none is lost; `fill_columns` reads them."""
        stamp_s = sample * self.period_s
        for frame in frames:
            rank = self._rank_by_id.get(frame.arbitration_id | frame.is_extended << 31)
            if rank is None:
                self.add(frame, stamp_s)
            else:
                self.frames.append((stamp_s, rank, frame))
        self.truth = self.readings = self.commands = sample + 1

    def fill_columns(self) -> None:
        """Read the numbers in the frames that `add_sample` added, all at once."""
        for kind, columns in self._columns.items():
            kept = [(stamp_s, frame) for stamp_s, rank, frame in self.frames if rank == _RANK[kind]]
            samples = np.rint(np.array([stamp_s for stamp_s, _ in kept]) / self.period_s).astype(np.intp)
            for name, values in columns.items():
                values[samples] = column(self.codec.by_kind[kind], name, [frame for _, frame in kept])

    def read_modes(self) -> None:
        """Read the modes in the commands that `add_sample` added: the reports are then those of a bench on a bus."""
        if not self._has_modes:
            return
        kept = [(stamp_s, frame) for stamp_s, rank, frame in self.frames if rank == _RANK[CurrentCommand]]
        modes = column(self.codec.by_kind[CurrentCommand], "mode", [frame for _, frame in kept])
        self.mode_reports[:0] = [
            ModeReport(stamp_s, Mode(int(mode))) for (stamp_s, _), mode in zip(kept, modes, strict=True)
        ]

    @property
    def _columns(self) -> Mapping[type[Message], Mapping[str, NDArray[np.float64]]]:
        truth = {"position_m": self.true_position_m, "velocity_m_per_s": self.true_velocity_m_per_s}
        return {
            PlantTruth: truth,
            StemPosition: {"position_m": self.measured_m},
            CurrentCommand: {"current_ma": self.current_ma},
        }

    def _sample_of(self, message: Message, counter: int | None) -> int:
        """Return the sample that a frame belongs to; -1 for frames from before the first truth."""
        if not self._counts and isinstance(message, StemPosition | CurrentCommand):
            return self._next_sample(message)
        match message:
            case PlantTruth():
                if self.origin is None:
                    self.origin = counter or 0
                steps = self._steps(counter, self.truth)
                self.lost += max(steps - 1, 0)
                self.truth += steps
                sample = self.truth - 1
            case StemPosition():
                self.readings += self._steps(counter, self.readings)
                sample = self.readings - 1
            case CurrentCommand():
                steps = self._steps(message.position_counter, self.commands)
                self.unanswered += max(steps - 1, 0)
                self.commands += steps
                sample = self.commands - 1
            case ActuatorState():
                sample = self.truth  # it is sent before the truth of its sample
            case Setpoint():
                self.setpoints += 1
                sample = (self.setpoints - 1) * self.samples_per_setpoint if self.lockstep else self.readings
            case PositionerStatus() if self.lockstep:  # its 8-bit counter wraps after 25.6 s
                self.statuses += ((counter or 0) - self.statuses) % _COUNTER + 1
                sample = (self.statuses - 1) * self._samples_per_status
            case PositionerCount() | PositionerAlarms() if self.lockstep:  # it is sent after its status
                sample = max(self.statuses - 1, 0) * self._samples_per_status
            case _:
                sample = max(self.commands - 1, 0)
        return sample

    def _next_sample(self, message: StemPosition | CurrentCommand) -> int:
        """Return the sample of a user's frame: a reading follows its truth, a command its reading."""
        if isinstance(message, StemPosition):
            self.readings = self.truth
            return self.readings - 1
        self.commands = self.commands + 1 if self.lockstep else self.readings
        return self.commands - 1

    def _steps(self, counter: int | None, expected: int) -> int:
        """Return by how many samples `counter` is past the last one, 0 for an echo of an older one."""
        if self.origin is None:
            return 0
        step = ((counter or 0) - self.origin - expected) % _COUNTER + 1
        return step if step <= _COUNTER // 2 else 0

    @property
    def _samples_per_status(self) -> int:
        return math.ceil(STATUS_PERIOD_NS / (self.period_s * 1e9) - 1e-9)

    @property
    def complete(self) -> int:
        """How many samples are complete: truth, reading and command."""
        return min(self.truth, self.readings, self.commands)

    @property
    def time_s(self) -> NDArray[np.float64]:
        """The plant's time of each sample, shape (samples,)."""
        return np.arange(self.samples, dtype=np.float64) * np.float64(self.period_s)

    @property
    def trace(self) -> Trace:
        """The samples that the figures are computed from."""
        return Trace(
            time_s=self.time_s,
            position_m=self.true_position_m,
            setpoint_m=self.setpoint_m,
            current_ma=self.current_ma,
        )

    def fill_gaps(self) -> None:
        """Fill the samples whose frame is missing, as in a real-time run, with the last known value."""
        for values in (self.true_position_m, self.true_velocity_m_per_s, self.measured_m, self.current_ma):
            known = np.flatnonzero(np.isfinite(values))
            if known.size:
                last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(values.size), known[0]))
                values[:] = values[last]

    def write_log(self, path: Path) -> None:
        """Write every frame as a candump log, which `canplayer -I` and `positioner replay` read."""
        write_frames(path, self.frames, by_rank=self.lockstep)
