"""Runs to replay, with the emulated valve in memory: as a bench logs them, and with faults on the wire."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from plant_emulator.device import advance, initial_device, publish, take
from plant_emulator.presets import plant_settings
from positioner.bench.configure import configuration_text
from positioner.bench.inprocess import run_in_process
from positioner.bench.scenario import Scenario
from positioner.bus.address import BusAddress
from positioner.config.reader import parse_config
from positioner.cycle.input import CycleInput
from positioner.cycle.state import CycleState, Setup
from positioner.cycle.step import step
from positioner.runtime.record import BusRecorder
from positioner.valve.stiction import StictionTable
from positioner.wire.messages import (
    CanFrame,
    CurrentCommand,
    HostRequest,
    PlantTruth,
    Quality,
    Setpoint,
    StemPosition,
)

if TYPE_CHECKING:
    from positioner.config.schema import Configuration
    from positioner.wire.codec import Codec

PERIOD_NS = 1_000_000
_NS = 1_000_000_000


def scenario(law: str = "nmpc", *, seconds: float = 0.3, seed: int = 1, **guard: object) -> Scenario:
    """Return a run of the paper's valve at 1 kHz, with three setpoints."""
    return Scenario(
        name="replayed",
        title="a run to replay",
        description="",
        law=law,
        seed=seed,
        sample_period_s=0.001,
        setpoint_period_s=0.01,
        setpoints_mm=(73.0, 87.0, 80.0),
        visits=1,
        dwell_s=seconds / 3,
        plant={"preset": "paper"},
        guard=dict(guard),
    )


def text_of(played: Scenario) -> str:
    """Return the `valve.toml` of a run."""
    return configuration_text(played, BusAddress(), Path("unused"))


def write_bench_log(folder: Path, played: Scenario, table: StictionTable | None = None) -> tuple[Path, Path]:
    """Write the log and the configuration of a lockstep bench of `played`; return their paths."""
    log, config = folder / "bus.log", folder / "valve.toml"
    run_in_process(played, table).recording.write_log(log)
    config.write_text(text_of(played), encoding="utf-8")
    return log, config


@dataclass(frozen=True)
class Instant:
    """The faults of one sample: of the feedback, the host, the bus, the table writer and the scheduling."""

    feedback: str = ""
    host: bool = True
    request: HostRequest = HostRequest.NONE
    setpoint_m: float = 0.08
    foreign: bool = False
    table_saved: bool = True
    late_ns: int = 0


def of_faults(sample: int) -> Instant:
    """Return the faults at `sample` of a run that has every fault, one after another."""
    setpoint_m = 0.087 if sample < 800 else 0.073 if sample < 1800 else 0.08
    noisy = 300 <= sample < 700
    feedback = (
        "lost" if (noisy and sample % 7 == 0) or 900 <= sample < 905 or 1200 <= sample < 1216
        else "damaged" if noisy and sample % 11 == 0
        else "repeated" if noisy and sample % 13 == 0
        else "faulty" if 2800 <= sample < 2802
        else "late" if noisy and sample % 17 == 0
        else ""
    )  # fmt: skip
    request = HostRequest.ARM if 50 <= sample < 1200 or sample >= 1400 else HostRequest.NONE
    return Instant(
        feedback,
        host=not 1950 <= sample < 2600,
        request=request,
        setpoint_m=0.5 if 2850 <= sample < 2870 else setpoint_m,
        foreign=2620 <= sample < 2630,
        table_saved=not 2300 <= sample < 2450,
        late_ns=1_234_567 if sample in {150, 151, 2500} else 0,
    )


def record_faults(folder: Path, played: Scenario) -> tuple[Path, Path]:
    """Write the positioner's own record of a run with these faults, and its configuration; return their paths."""
    log, config = folder / "bus.log", folder / "valve.toml"
    config.write_text(text_of(played), encoding="utf-8")
    configuration = parse_config(text_of(played), str(config), folder)
    _Faulty(configuration, played, log).play(round(played.duration_s * 1e9 / PERIOD_NS))
    return log, config


def without_truth(log: Path) -> None:
    """Remove the truth frames from a log: no positioner reads them."""
    lines = log.read_text(encoding="ascii").splitlines(keepends=True)
    log.write_text("".join(line for line in lines if " 170#" not in line), encoding="ascii")


class _Faulty:
    """The loop of daemon and device, with faults between them."""

    def __init__(self, configuration: Configuration, played: Scenario, log: Path) -> None:
        self.codec: Codec = configuration.make_codec()
        law, period_s = configuration.make_law(), configuration.control.sample_period_s
        self.setup = Setup(self.codec, configuration.valve, configuration.guard, law, period_s)
        self.state = CycleState(table=StictionTable(cell_width_m=configuration.control.table_cell_m))
        self.settings = plant_settings(overrides=played.plant)
        self.device = initial_device(self.settings, played.seed)
        self.recorder = BusRecorder(log)
        self.held: list[CanFrame] = []
        self.setpoints = 0

    def play(self, samples: int) -> None:
        for sample in range(samples):
            now = of_faults(sample)
            inbox = [*self._of_host(sample, now), *self._of_plant(now)]
            if now.foreign:
                inbox.append(self.codec.encode(CurrentCommand(12.0), 7 * sample))
            # a cycle begins a little later than its sample, as on a machine, and each time by another delay
            now_ns = sample * PERIOD_NS + 1000 * (100 + sample * 37 % 91)
            cycle_input = CycleInput(tuple(inbox), now_ns, now.late_ns, table_saved=now.table_saved)
            self.state, outbox, _ = step(self.setup, self.state, cycle_input)
            self.recorder.cycle(cycle_input, outbox, self.state.guard)
            self.device = advance(self.settings, take(self.codec, self.device, outbox), PERIOD_NS / _NS)
        self.recorder.close()

    def _of_host(self, sample: int, now: Instant) -> list[CanFrame]:
        if sample % 10 or not now.host:
            return []
        self.setpoints += 1
        return [self.codec.encode(Setpoint(now.setpoint_m, now.request), self.setpoints - 1)]

    def _of_plant(self, now: Instant) -> list[CanFrame]:
        truth_id = self.codec.identifier(PlantTruth)[0]
        self.device, published = publish(self.codec, self.settings, self.device)
        frames = [frame for frame in published if frame.arbitration_id != truth_id]
        frames, self.held = [*self.held, *frames], []
        match now.feedback:
            case "lost":
                return frames[:-1]
            case "damaged":
                data = frames[-1].data
                return [*frames[:-1], replace(frames[-1], data=data[:4] + bytes((data[4] ^ 0x10,)) + data[5:])]
            case "repeated":
                return [*frames, frames[-1]]
            case "faulty":
                message, counter = self.codec.decode(frames[-1])
                assert isinstance(message, StemPosition)
                return [*frames[:-1], self.codec.encode(replace(message, quality=Quality.FAULT), counter or 0)]
            case "late":
                self.held = [frames[-1]]
                return frames[:-1]
            case _:
                return frames
