"""`plant-emulator run`: the valve on a bus. Shell."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from plant_emulator.cli.plant_options import SECONDS, add_plant_options, plant_of
from plant_emulator.daemon import EmulatorDaemon, EmulatorOptions
from positioner.bus.address import parse_address
from positioner.errors import ConfigurationError, UsageError
from positioner.inputs.numbers import number, whole
from positioner.wire.codec import make_codec
from positioner.wire.file import wire_codec
from positioner.wire.messages import StemPosition
from positioner.wire.ranges import span_problems
from positioner.wire.settings import WireSettings

if TYPE_CHECKING:
    from plant_emulator.parameters import PlantSettings
    from positioner.errors import ExitCode
    from positioner.wire.codec import Codec

_EXAMPLE = """\
examples:
  plant-emulator run --preset paper --bus socketcan:vcan0 --period 0.001
  plant-emulator run --preset real-valve --set sensor.time_constant_s=0.005 --set actuator.slew_pa_per_s=4e5
  plant-emulator run --config plant.toml     with every key and with faults that come later: examples/plant.toml
  plant-emulator run --wire fv101.toml       with the frames of your own DBC: docs/own-dbc.md
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        "run",
        help="put the valve on a CAN bus",
        description="Put the valve on a CAN bus: it sends its position every period and obeys the command frames.",
        epilog=_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_plant_options(parser)
    parser.add_argument(
        "--bus", default="socketcan:vcan0", metavar="INTERFACE:CHANNEL", help="the bus (default: %(default)s)"
    )
    parser.add_argument(
        "--period", type=SECONDS, default=0.001, metavar="S", help="period of the frames (default: %(default)s s)"
    )
    parser.add_argument(
        "--seed",
        type=whole,
        default=1,
        metavar="N",
        help="seed of noise and stochastic friction (default: %(default)s)",
    )
    parser.add_argument(
        "--clock",
        choices=("realtime", "lockstep"),
        default="realtime",
        help="send every period, or wait for each answer of the positioner (default: %(default)s)",
    )
    parser.add_argument(
        "--command-delay",
        type=number(0.0, 1.0, "seconds from 0 to 1"),
        default=0.0,
        metavar="S",
        help="commands act this long after a reading, up to a period; 0: once they arrive (default: %(default)g s)",
    )
    parser.add_argument("--setpoint-every", type=whole, default=0, metavar="N", help=argparse.SUPPRESS)
    frames = parser.add_mutually_exclusive_group()
    frames.add_argument(
        "--wire",
        type=Path,
        metavar="FILE",
        help="frames of your own DBC: [wire] of this configuration",
    )
    frames.add_argument(
        "--id-offset",
        type=int,
        default=0,
        metavar="N",
        help="number added to all identifiers, a multiple of 128 (default: %(default)s)",
    )
    parser.add_argument("--valve", metavar="ID", help="which valve is meant, where --wire has several")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> ExitCode:
    settings = plant_of(arguments)
    if arguments.command_delay > arguments.period:
        raise UsageError(f"--command-delay {arguments.command_delay:g} is longer than --period {arguments.period:g}")
    options = EmulatorOptions(
        bus=parse_address(arguments.bus),
        period_s=arguments.period,
        seed=arguments.seed,
        lockstep=arguments.clock == "lockstep",
        setpoint_every=arguments.setpoint_every,
        command_delay_s=arguments.command_delay,
    )
    return EmulatorDaemon(settings, _codec(arguments, settings), options).run()


def _codec(arguments: argparse.Namespace, settings: PlantSettings) -> Codec:
    valve = settings.valve
    if arguments.wire is None:
        if arguments.valve is not None:
            raise UsageError("--valve names a valve of the file that --wire gives: give both")
        return make_codec(WireSettings(id_offset=arguments.id_offset), span_m=valve.span_m)
    codec = wire_codec(arguments.wire, arguments.valve, span_m=valve.span_m)
    form = codec.field(StemPosition, "position_m")
    if problems := span_problems(form, (valve.travel_min_m, valve.travel_max_m), valve.span_m):
        raise ConfigurationError(str(arguments.wire), problems)
    return codec
