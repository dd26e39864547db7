"""`positioner bench`: the control of an emulated valve. Shell."""

from __future__ import annotations

import argparse
import signal
import sys
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.bench.scenario import load_scenario, scenario_names
from positioner.bus.address import parse_address
from positioner.cli.command import add_command, add_state
from positioner.errors import BenchError, ExitCode
from positioner.laws.registry import LAWS
from positioner.studies.conditions import ALL_PLANTS
from positioner.studies.interpretations import NoiseKind, Units, interpreted_as

if TYPE_CHECKING:
    from positioner.cli.command import Commands


def _listed(title: str, names: tuple[str, ...]) -> str:
    return textwrap.fill(f"{title + ':':11}{', '.join(names)}", 100, subsequent_indent=" " * 11)


_EPILOG = f"""\
examples:
  positioner bench                                      the paper's valve, three setpoints, each visited three times
  positioner bench --scenario noise-free --out noise-free
  positioner bench --state bench-paper-valve/state      start from the table of an earlier run
  positioner bench --scenario paper-3 --reading B       the paper's third simulation with held noise
  positioner bench --clock realtime                     at the machine's own pace, and how well it was kept

It starts the plant emulator and the daemon as processes on one bus and sends the scenario's setpoints as frames. The
output directory then holds: result.json (the figures), trend.png (the picture), bus.log (candump format, for
canplayer), trace.csv (estimates and decisions of the law), both configurations and both logs.

--reading chooses the interpretation of the paper's noise: A, white noise and a Kalman filter (D11); B, each draw of the
noise held for 10 ms, position and speed from raw readings; or noise-free. --units chooses the units of α and β of
eq. 22: SI or cm (D6).

exit status: 0 done; 1 failed, or the positioner was ACTIVE for less than 99 % of the run (the figures are then not the
law's); 78 the scenario is wrong.

{_listed("scenarios", scenario_names())}
{_listed("laws", tuple(LAWS))}
{_listed("plants", ALL_PLANTS)}
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner bench`."""
    parser = add_command(
        commands, "bench", _run, "control an emulated valve, with figures and a picture; no hardware needed", _EPILOG
    )
    parser.add_argument(
        "--scenario", default="paper-valve", metavar="NAME|FILE", help="scenario to play (default: %(default)s)"
    )
    parser.add_argument("--law", choices=tuple(LAWS), metavar="NAME", help="control law instead of the scenario's")
    parser.add_argument(
        "--plant", choices=ALL_PLANTS, metavar="NAME", help="preset of the emulator instead of the scenario's"
    )
    parser.add_argument("--seed", type=_seed, metavar="N", help="seed instead of the scenario's")
    parser.add_argument(
        "--reading", choices=tuple(NoiseKind), metavar="A|B|noise-free", help="interpretation of the paper's noise"
    )
    parser.add_argument("--units", choices=tuple(Units), metavar="SI|cm", help="units of the paper's α and β")
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
    parser.add_argument("--out", type=Path, metavar="DIR", help="output directory (default: bench-SCENARIO)")
    add_state(parser, "start from the table in DIR, and save the table there")


def _seed(text: str) -> int:
    if not text.isdecimal() or int(text) >= 1 << 32:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 to {(1 << 32) - 1}")
    return int(text)


def _run(arguments: argparse.Namespace) -> ExitCode:
    # the runner imports matplotlib, which would slow every other command down
    from positioner.bench.modes import complaint  # noqa: PLC0415
    from positioner.bench.play import BenchOptions  # noqa: PLC0415
    from positioner.bench.result import to_text  # noqa: PLC0415
    from positioner.bench.runner import run_bench  # noqa: PLC0415

    # SIGTERM ends the processes of the bench, as Ctrl-C does
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    scenario = load_scenario(arguments.scenario)
    scenario = replace(
        scenario,
        law=arguments.law or scenario.law,
        seed=scenario.seed if arguments.seed is None else arguments.seed,
        plant={**scenario.plant, "preset": arguments.plant} if arguments.plant else scenario.plant,
    )
    scenario = interpreted_as(
        scenario,
        NoiseKind(arguments.reading) if arguments.reading else None,
        Units(arguments.units) if arguments.units else None,
    )
    out = arguments.out or Path(f"bench-{scenario.name}")
    options = BenchOptions(
        bus=None if arguments.bus == "auto" else parse_address(arguments.bus),
        lockstep=arguments.clock == "lockstep",
        out=out,
        state=arguments.state,
        plant_bus=parse_address(arguments.plant_bus) if arguments.plant_bus else None,
    )
    result = run_bench(scenario, options, lambda line: sys.stderr.write(f"{line}\n"))
    sys.stdout.write(to_text(result))
    state = arguments.state or out / "state"
    sys.stdout.write(f"\n{out}: result.json, trend.png, bus.log; the learned table is in {state}\n")
    if wrong := complaint(result.modes, str(out / "positioner.log")):
        sys.stdout.flush()
        raise BenchError(wrong)
    return ExitCode.OK
