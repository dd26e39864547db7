"""Before a bench: `positioner identify` on its bus, then `positioner reach`, as a person commissions a valve. Shell.

The experiment begins with the configuration of the scenario, and writes what it finds into that file.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from positioner.bench.play import wire_arguments
from positioner.bench.processes import BenchProcess
from positioner.errors import BenchError

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.bench.play import BenchOptions
    from positioner.bench.scenario import Scenario
    from positioner.config.schema import Configuration

_POLL_S = 0.1


def commission(
    scenario: Scenario, options: BenchOptions, configuration: Configuration, say: Callable[[str], object]
) -> None:
    """Identify the emulated valve, write the values into `valve.toml`, and say what it can reach.

    Raises:
        BenchError: a process failed.
    """
    out, clock = options.out, "lockstep" if options.lockstep else "realtime"
    plant_arguments = ["run", "--config", str(out / "plant.toml"), "--clock", clock, "--seed", str(scenario.seed)]
    plant_arguments += ["--bus", str(options.plant_bus or configuration.bus)]
    plant_arguments += ["--period", repr(scenario.sample_period_s), *wire_arguments(scenario, out)]
    valve = ["--config", str(out / "valve.toml")]
    for name in ("plant-emulator.log", "identify.log", "reach.log"):
        (out / name).unlink(missing_ok=True)
    say("positioner identify: the valve is measured first, in about two minutes of its time")
    arguments = ["identify", *valve, "--yes", "--write", "--clock", clock, "--picture", str(out / "identify.png")]
    with BenchProcess("positioner.cli.main", arguments, out / "identify.log") as identify:
        identify.wait_for("waiting for position frames")
        with BenchProcess("plant_emulator.cli.main", plant_arguments, out / "plant-emulator.log"):
            _finish(identify, say)
    with BenchProcess("positioner.cli.main", ["reach", *valve], out / "reach.log") as reach:
        _finish(reach, say)


def _finish(command: BenchProcess, say: Callable[[str], object]) -> None:
    """Wait until a command ends, and say what it wrote.

    Raises:
        BenchError: it failed.
    """
    while command.process.poll() is None:
        command.drain()
        time.sleep(_POLL_S)
    say(command.log.read_text(encoding="utf-8").rstrip())
    if command.process.returncode:
        raise BenchError(f"{command.log.stem} ended with status {command.process.returncode}; its log is {command.log}")
