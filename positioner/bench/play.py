"""The processes of a bench on their bus: the emulator, the daemon, and this one as the host. Shell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.bench.host import Host
from positioner.bench.processes import BenchProcess, prioritize
from positioner.bench.recording import Recording
from positioner.bench.timing import answers, timing_of
from positioner.bus.port import BusPort
from positioner.errors import StateError
from positioner.wire.messages import (
    ActuatorState,
    CurrentCommand,
    PlantTruth,
    PositionerAlarms,
    PositionerCount,
    PositionerStatus,
    StemPosition,
)

if TYPE_CHECKING:
    from pathlib import Path

    from positioner.bench.scenario import Scenario
    from positioner.bench.timing import Timing
    from positioner.bus.address import BusAddress
    from positioner.config.schema import Configuration

_PLANT_PRIORITY, _DAEMON_PRIORITY, _HOST_PRIORITY = 60, 50, 40
"""In real time: the plant stands for hardware, which waits for nobody; the daemon has the priority of realtime.conf."""
_RECEIVED = (
    StemPosition,
    ActuatorState,
    PlantTruth,
    CurrentCommand,
    PositionerStatus,
    PositionerCount,
    PositionerAlarms,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchOptions:
    """How a bench runs.

    bus: with None, the bench chooses one. out: the output directory. state: the table's directory; with None, a new one
    in `out`. plant_bus: the emulator's own interface to the same bus, as on hardware.
    """

    bus: BusAddress | None
    lockstep: bool
    out: Path
    state: Path | None
    plant_bus: BusAddress | None = None


def play(
    scenario: Scenario, options: BenchOptions, configuration: Configuration, state: Path
) -> tuple[Recording, Timing | None]:
    """Return the recording of the run, and in real time how it kept time.

    Raises:
        BenchError: a process failed, or frames were lost.
        StateError: the table was not saved.
    """
    out, clock = options.out, "lockstep" if options.lockstep else "realtime"
    codec = configuration.make_codec()
    samples = round(scenario.duration_s / scenario.sample_period_s)
    recording = Recording(codec, samples, scenario.sample_period_s, scenario.samples_per_setpoint, options.lockstep)
    bus = BusPort(configuration.bus, [codec.identifier(kind) for kind in _RECEIVED])
    bus.open()
    for name in ("plant-emulator.log", "positioner.log"):
        (out / name).unlink(missing_ok=True)
    daemon_arguments = ["run", "--config", str(out / "valve.toml"), "--state", str(state), "--clock", clock]
    daemon_arguments += ["--trace", str(out / "trace.csv")]
    plant_bus, delay_s = options.plant_bus or configuration.bus, configuration.control.command_delay_s
    plant_arguments = ["run", "--config", str(out / "plant.toml"), "--bus", str(plant_bus), "--clock", clock]
    plant_arguments += ["--period", repr(scenario.sample_period_s), "--seed", str(scenario.seed)]
    plant_arguments += ["--command-delay", repr(delay_s), "--setpoint-every", str(scenario.samples_per_setpoint)]
    plant_arguments += wire_arguments(scenario, out)
    if options.lockstep:
        daemon_arguments += ["--setpoint-every", str(scenario.samples_per_setpoint)]
    else:
        daemon_arguments += ["--record", str(out / "bus.log")]
    timing: Timing | None = None
    try:
        with BenchProcess("positioner.cli.main", daemon_arguments, out / "positioner.log") as daemon:
            daemon.wait_for("waiting for position frames")
            with BenchProcess("plant_emulator.cli.main", plant_arguments, out / "plant-emulator.log") as plant:
                plant.wait_for("READY=1")
                children = (daemon, plant)
                host = Host(scenario, codec, bus, recording, lambda: _check(children))
                if options.lockstep:
                    host.play_lockstep()
                else:
                    pids = [child.process.pid for child in children]
                    first = prioritize(pids[1], _PLANT_PRIORITY) and prioritize(pids[0], _DAEMON_PRIORITY)
                    prioritize(0, _HOST_PRIORITY)
                    seconds = host.play_real_time(pids)
                    prioritize(0, 0)
                    answered = answers(codec, ((time_s, frame) for time_s, _, frame in recording.frames))
                    due_s = delay_s or scenario.sample_period_s
                    timing = timing_of(answered, seconds, due_s, "SCHED_FIFO" if first else "SCHED_OTHER")
                code = daemon.stop()
                if code:
                    raise StateError(f"the positioner ended with status {code}; see {daemon.log}")
    finally:
        bus.close()
    if not options.lockstep:
        recording.fill_gaps()
    return recording, timing


def wire_arguments(scenario: Scenario, out: Path) -> list[str]:
    """Return the arguments with which the emulator has the same frames as the daemon of `valve.toml`."""
    return ["--wire", str(out / "valve.toml")] if scenario.wire else []


def _check(children: tuple[BenchProcess, ...]) -> None:
    for child in children:
        child.drain()
        child.check()
