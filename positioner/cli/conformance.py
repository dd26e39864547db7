"""`positioner conformance`: test whether another node keeps the rules of docs/protocol.md. Shell."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

from positioner.bus.address import parse_address
from positioner.cli.command import add_command
from positioner.cli.tables import add_output, show, show_json
from positioner.conformance.host import HostLimits, HostTest
from positioner.conformance.on_bus import ConformanceTest, run_test
from positioner.conformance.plant import PlantLimits, PlantTest
from positioner.conformance.report import as_values, blocks
from positioner.conformance.rules import conforms
from positioner.conformance.script import Script
from positioner.errors import ExitCode
from positioner.inputs.numbers import number
from positioner.wire.codec import make_codec
from positioner.wire.loop_current import VALUE_HIGH_MA, VALUE_LOW_MA
from positioner.wire.settings import WireSettings

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.cli.command import Commands
    from positioner.wire.codec import Codec

_SECONDS = number(0.0001, 3600.0, "a time from 0.0001 to 3600 s")
_EPILOG = """\
It prints one line for each rule: pass, FAIL or not seen (the node had no occasion to break it). For each FAIL there
follow the first frame that breaks the rule, and the fix.

examples:
  positioner conformance plant --bus socketcan:can0
  positioner conformance host --bus socketcan:can0 --travel 0:127

exit status: 0 no rule is broken, 1 a rule is broken, 69 the bus cannot be used or another controller is on it.
"""
_PLANT_EPILOG = """\
With --currents the plant is commanded within these limits, and several times it gets no commands until it goes to its
fail position: THE VALVE MOVES. Without --currents nothing is sent.

examples:
  positioner conformance plant --bus socketcan:can0
  positioner conformance plant --bus socketcan:can0 --currents 8:9
"""
_HOST_EPILOG = """\
Nothing is sent. Operate the host while the test listens: arm, move, disarm.

example:
  positioner conformance host --bus socketcan:can0 --travel 0:127
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner conformance`."""
    parser = add_command(
        commands, "conformance", None, "test whether another node keeps the rules of docs/protocol.md", _EPILOG
    )
    nodes = parser.add_subparsers(title="nodes", metavar="NODE", required=True)
    for name, run, text, epilog in (
        ("plant", _plant, "test the node that measures the position and drives the valve", _PLANT_EPILOG),
        ("host", _host, "test the node that sends setpoints", _HOST_EPILOG),
    ):
        node = add_command(nodes, name, run, text, epilog)
        node.add_argument("--bus", required=True, metavar="INTERFACE:CHANNEL", help="the bus")
        node.add_argument(
            "--id-offset",
            type=int,
            default=0,
            metavar="N",
            help="wire.id_offset of the positioner (default: %(default)s)",
        )
        node.add_argument("--travel", type=_range(-1e3, 1e3, "mm"), metavar="LOW:HIGH", help="allowed positions, in mm")
        add_output(node)
        if name == "plant":
            node.add_argument(
                "--period",
                type=_SECONDS,
                default=0.001,
                metavar="S",
                help="sample period of the plant (default: %(default)s s)",
            )
            node.add_argument(
                "--deadman",
                type=_SECONDS,
                default=0.1,
                metavar="S",
                help="deadman of the plant: time without a command until its fail position (default: %(default)s s)",
            )
            node.add_argument(
                "--currents",
                type=_range(VALUE_LOW_MA, VALUE_HIGH_MA, "mA"),
                metavar="LOW:HIGH",
                help="command the plant within these limits, in mA: THE VALVE MOVES",
            )
            node.add_argument(
                "--listen",
                type=_SECONDS,
                default=1.0,
                metavar="S",
                help="first listen for this time (default: %(default)s s)",
            )
        else:
            node.add_argument(
                "--hold",
                type=_SECONDS,
                default=0.5,
                metavar="S",
                help="guard.setpoint_hold_s of the positioner (default: %(default)s s)",
            )
            node.add_argument(
                "--listen",
                type=_SECONDS,
                default=10.0,
                metavar="S",
                help="listen for this time (default: %(default)s s)",
            )


def _plant(arguments: argparse.Namespace) -> ExitCode:
    limits = PlantLimits(period_s=arguments.period, deadman_s=arguments.deadman, travel_m=_metres(arguments.travel))
    codec = make_codec(WireSettings(id_offset=arguments.id_offset))
    script = Script(codec, arguments.currents, limits.deadman_s, limits.settle_s, arguments.listen)
    test = PlantTest(codec, limits, script, arguments.id_offset)
    return _run("plant", arguments, codec, test, alone=arguments.currents is not None)


def _host(arguments: argparse.Namespace) -> ExitCode:
    codec = make_codec(WireSettings(id_offset=arguments.id_offset))
    limits = HostLimits(hold_s=arguments.hold, travel_m=_metres(arguments.travel))
    test = HostTest(codec, limits, arguments.listen, arguments.id_offset)
    return _run("host", arguments, codec, test, alone=False)


def _run(node: str, arguments: argparse.Namespace, codec: Codec, test: ConformanceTest, *, alone: bool) -> ExitCode:
    results, start_ns = run_test(parse_address(arguments.bus), codec, test, alone=alone)
    if arguments.json:
        show_json(as_values(node, results, start_ns))
    else:
        show(blocks(node, results, start_ns), as_markdown=arguments.markdown)
    return ExitCode.OK if conforms(results) else ExitCode.FAILURE


def _metres(range_mm: tuple[float, float] | None) -> tuple[float, float] | None:
    return None if range_mm is None else (range_mm[0] * 1e-3, range_mm[1] * 1e-3)


def _range(lowest: float, highest: float, unit: str) -> Callable[[str], tuple[float, float]]:
    """Return the function that reads `LOW:HIGH` within `lowest` and `highest`."""

    def read(text: str) -> tuple[float, float]:
        try:
            low, high = (float(part) for part in text.split(":"))
        except ValueError:
            low = high = math.nan
        if not lowest <= low <= high <= highest:
            raise argparse.ArgumentTypeError(f"{text!r} is not LOW:HIGH within {lowest:g} and {highest:g} {unit}")
        return low, high

    return read
