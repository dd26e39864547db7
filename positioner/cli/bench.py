"""`positioner bench`: the control of an emulated valve. Shell."""

from __future__ import annotations

import argparse
import signal
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.bench.own_plant import with_own_physics, with_plant
from positioner.bench.scenario import check_scenario, load_scenario, scenario_names
from positioner.bench.sensor_noise import with_noise
from positioner.bench.setpoints import with_setpoints
from positioner.bus.address import parse_address
from positioner.cli.command import add_command, add_state, add_valve
from positioner.cli.names import add_law, add_plant, add_signals, law_of, plant_of
from positioner.cli.run_report import add_report, check_report, command_again, picture_in, write_page
from positioner.cli.tables import add_output, note, show_result
from positioner.errors import BenchError, ExitCode, UsageError
from positioner.laws.registry import law_names
from positioner.machine.completion import suggest
from positioner.studies.conditions import known_plants
from positioner.studies.interpretations import NoiseKind, Units, interpreted_as
from positioner.wire.file import wire_codec, wire_table

if TYPE_CHECKING:
    from positioner.bench.result import Result
    from positioner.bench.scenario import Scenario
    from positioner.cli.command import Commands


def _listed(title: str, names: tuple[str, ...]) -> str:
    return textwrap.fill(f"{title + ':':11}{', '.join(names)}", 100, subsequent_indent=" " * 11)


_EPILOG = f"""\
examples:
  positioner bench                                      the paper's valve, three setpoints, each visited three times
  positioner bench --scenario noise-free --out noise-free
  positioner bench --state bench-paper-valve/state      start from the table of an earlier run
  positioner bench --law examples/my_law.py:MyLaw       a law of your own: docs/own-law.md
  positioner bench --setpoints ramp:10,from=50%,to=70% --noise uniform:0.05%
  positioner bench --plant examples/plant.toml --dwell 3   your plant, in a file that `plant-emulator run` takes, too
  positioner bench --scenario paper-3 --reading B       the paper's third simulation with held noise
  positioner bench --report paper-valve.html            and write it all into one HTML page
  positioner bench --clock realtime                     at the machine's own pace, and how well it was kept
  positioner bench --wire examples/percent.toml         over the frames of a DBC of your own: docs/own-dbc.md

It starts the plant emulator and the daemon as processes on one bus and sends the scenario's setpoints as frames. The
output directory then holds: result.json (the figures), trend.png (the run) and moves.png (single moves, in ms), both
also as .svg, bus.log (candump format, for canplayer), trace.csv (estimates and decisions of the law), both
configurations and both logs.

--reading chooses the interpretation of the paper's noise: A, white noise and a Kalman filter (D11); B, each draw of the
noise held for 10 ms, position and speed from raw readings; or noise-free. --units chooses the units of α and β of
eq. 22: SI or cm (D6).

exit status: 0 done; 1 failed, or the positioner was ACTIVE for less than 99 % of the run (the figures are then not the
law's); 78 the scenario is wrong.

{_listed("scenarios", scenario_names())}
{_listed("laws", law_names())}
{_listed("plants", known_plants())}
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner bench`."""
    parser = add_command(
        commands, "bench", _run, "control an emulated valve, with figures and pictures; no hardware needed", _EPILOG
    )
    scenario = parser.add_argument(
        "--scenario", default="paper-valve", metavar="NAME|FILE", help="scenario to play (default: %(default)s)"
    )
    suggest(scenario, scenario_names, "*.toml")
    add_law(parser, "control law instead of the scenario's")
    add_plant(parser, "plant instead of the scenario's")
    add_signals(parser)
    parser.add_argument("--dwell", type=float, metavar="S", help="length of a dwell instead of the scenario's, in s")
    parser.add_argument("--seed", type=_seed, metavar="N", help="seed instead of the scenario's")
    parser.add_argument(
        "--reading",
        choices=tuple(NoiseKind),
        metavar="A|B|noise-free",
        help="interpretation of the paper's noise, see below",
    )
    parser.add_argument(
        "--units", choices=tuple(Units), metavar="SI|cm", help="units of the paper's α and β, see below"
    )
    parser.add_argument(
        "--bus",
        default="auto",
        metavar="auto|INTERFACE:CHANNEL",
        help="auto: a vcan interface of this machine, else the embedded bus (default: %(default)s)",
    )
    parser.add_argument(
        "--plant-bus", metavar="INTERFACE:CHANNEL", help="the emulator's own interface to the same bus, if it has one"
    )
    parser.add_argument(
        "--clock",
        choices=("lockstep", "realtime"),
        default="lockstep",
        help="lockstep: as fast as possible, repeatable to the bit; realtime: as on hardware (default: %(default)s)",
    )
    parser.add_argument(
        "--wire", type=Path, metavar="FILE", help="frames of your own DBC: [wire] of this configuration"
    )
    add_valve(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="output directory (default: bench-SCENARIO)")
    add_output(parser)
    add_report(parser)
    add_state(parser, "start from the table in DIR, and save the table there")


def _seed(text: str) -> int:
    if not text.isdecimal() or int(text) >= 1 << 32:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 to {(1 << 32) - 1}")
    return int(text)


def _scenario(arguments: argparse.Namespace) -> Scenario:
    """Return the scenario with what the command line changes.

    Raises:
        UsageError, ConfigurationError: it cannot be played so.
    """
    scenario = load_scenario(arguments.scenario)
    scenario = replace(
        scenario,
        law=law_of(arguments) or scenario.law,
        seed=scenario.seed if arguments.seed is None else arguments.seed,
    )
    plant = plant_of(arguments)
    scenario = with_plant(scenario, plant) if plant else with_own_physics(scenario)
    if arguments.noise:
        scenario = with_noise(scenario, arguments.noise)
    if arguments.dwell is not None:
        scenario = replace(scenario, dwell_s=arguments.dwell)
    if arguments.setpoints:
        scenario = with_setpoints(scenario, arguments.setpoints)
    if arguments.dwell is not None:
        if scenario.edges_s:
            raise UsageError("--dwell is for setpoints that stand still; these move")
        check_scenario(scenario, "--dwell")
    if arguments.wire:
        wire_codec(arguments.wire, arguments.valve)  # a mistake is one in this file, with its line
        scenario = replace(scenario, wire=wire_table(arguments.wire, arguments.valve))
    elif arguments.valve:
        raise UsageError("--valve names a valve of the file that --wire gives: give both")
    return interpreted_as(
        scenario,
        NoiseKind(arguments.reading) if arguments.reading else None,
        Units(arguments.units) if arguments.units else None,
    )


def _run(arguments: argparse.Namespace) -> ExitCode:
    # the runner imports matplotlib, which would slow every other command down
    from positioner.bench.modes import complaint  # noqa: PLC0415
    from positioner.bench.play import BenchOptions  # noqa: PLC0415
    from positioner.bench.result import blocks, to_json  # noqa: PLC0415
    from positioner.bench.runner import run_bench  # noqa: PLC0415

    check_report(arguments)
    # SIGTERM ends the processes of the bench, as Ctrl-C does
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    scenario = _scenario(arguments)
    out = arguments.out or Path(f"bench-{scenario.name}")
    options = BenchOptions(
        bus=None if arguments.bus == "auto" else parse_address(arguments.bus),
        lockstep=arguments.clock == "lockstep",
        out=out,
        state=arguments.state,
        plant_bus=parse_address(arguments.plant_bus) if arguments.plant_bus else None,
    )
    result = run_bench(scenario, options, note)
    show_result(arguments, blocks(result), to_json(result))
    state = arguments.state or out / "state"
    note(f"\n{out}: result.json, bus.log, trend and moves (.png, .svg); the learned table is in {state}")
    if arguments.report:
        _write_report(arguments, result, out)
    if wrong := complaint(result.modes, str(out / "positioner.log")):
        raise BenchError(wrong)
    return ExitCode.OK


def _write_report(arguments: argparse.Namespace, result: Result, out: Path) -> None:
    from positioner.bench.report_page import bench_page  # noqa: PLC0415

    pictures = (picture_in(out / "trend.svg", "The run"), picture_in(out / "moves.svg", "Single moves"))
    again = command_again(arguments, "bench", _PLAYED, seed=result.scenario.seed)
    write_page(arguments.report, bench_page(result, pictures, again))


_PLAYED = (
    "scenario",
    "law",
    "plant",
    "setpoints",
    "noise",
    "dwell",
    "seed",
    "reading",
    "units",
    "clock",
    "wire",
    "state",
)
"""Options on which the figures depend."""
