"""`positioner bench`: the loop closed with an emulated valve. Shell."""

from __future__ import annotations

import argparse
import signal
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

from positioner.bench.scenario import load_scenario, scenario_names
from positioner.bus.address import parse_address
from positioner.errors import BenchError, ExitCode
from positioner.laws.registry import LAWS
from positioner.studies.conditions import ALL_PLANTS
from positioner.studies.interpretations import Noise, Units, interpreted_as


def _listed(what: str, names: tuple[str, ...]) -> str:
    return textwrap.fill(f"{what + ':':11}{', '.join(names)}", 100, subsequent_indent=" " * 11)


_EPILOG = f"""\
examples:
  positioner bench                                      the paper's valve, three setpoints visited three times
  positioner bench --scenario noise-free --out noise-free
  positioner bench --state bench-paper-valve/state      start from the table that an earlier run left
  positioner bench --scenario paper-3 --reading B       the paper's third simulation, its noise read as held

It starts the plant emulator and the daemon as processes on one bus, plays the scenario's setpoints as frames, and
leaves in the output directory: result.json (the figures), trend.png (the picture), bus.log (candump format, for
canplayer), trace.csv (what the law believed), both configurations and both logs.

--reading sets sensor and estimator: A, white noise and a Kalman filter (D11); B, each draw of the noise held for 10 ms,
position and speed from raw readings; noise-free. --units says of α and β of eq. 22 whether they are SI or in cm (D6).

exit status: 0 done, 1 failed, or ACTIVE for less than 99 % of the run (its figures are then not the law's), 78 the
scenario is wrong.

{_listed("scenarios", scenario_names())}
{_listed("laws", tuple(LAWS))}
{_listed("plants", ALL_PLANTS)}
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        "bench",
        help="close the loop with an emulated valve",
        description="Close the loop with an emulated valve, and measure it.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--scenario", default="paper-valve", metavar="NAME|FILE", help="what is played (%(default)s)")
    parser.add_argument("--law", choices=tuple(LAWS), metavar="NAME", help="control law instead of the scenario's")
    parser.add_argument(
        "--plant", choices=ALL_PLANTS, metavar="NAME", help="preset of the emulator instead of the scenario's"
    )
    parser.add_argument("--seed", type=_seed, metavar="N", help="seed instead of the scenario's")
    parser.add_argument("--reading", choices=tuple(Noise), metavar="A|B|noise-free", help="of the paper's noise")
    parser.add_argument("--units", choices=tuple(Units), metavar="SI|cm", help="of the paper's α and β")
    parser.add_argument(
        "--bus",
        default="auto",
        metavar="auto|INTERFACE:CHANNEL",
        help="auto: a vcan of this machine, else the embedded bus (%(default)s)",
    )
    parser.add_argument(
        "--plant-bus", metavar="INTERFACE:CHANNEL", help="where the emulator has an interface of its own on that bus"
    )
    parser.add_argument(
        "--clock",
        choices=("lockstep", "realtime"),
        default="lockstep",
        help="lockstep: as fast as the machine allows and the same to the bit; realtime: as on hardware (%(default)s)",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="output directory (bench-SCENARIO)")
    parser.add_argument("--state", type=Path, metavar="DIR", help="start from the table in DIR, and save it there")
    parser.set_defaults(run=_run)


def _seed(text: str) -> int:
    if not text.isdecimal() or int(text) >= 1 << 32:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 0 to {(1 << 32) - 1}")
    return int(text)


def _run(arguments: argparse.Namespace) -> ExitCode:
    # the runner draws pictures: its imports would slow every other command down
    from positioner.bench.modes import complaint  # noqa: PLC0415
    from positioner.bench.result import to_text  # noqa: PLC0415
    from positioner.bench.runner import BenchOptions, run_bench, with_law  # noqa: PLC0415

    # whoever ends the bench ends its processes, too, as Ctrl-C does
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    scenario = with_law(load_scenario(arguments.scenario), arguments.law, arguments.seed)
    if arguments.plant:
        scenario = replace(scenario, plant={**scenario.plant, "preset": arguments.plant})
    scenario = interpreted_as(
        scenario,
        Noise(arguments.reading) if arguments.reading else None,
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
