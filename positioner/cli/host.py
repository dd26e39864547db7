"""`positioner host`: arm a valve, move it, take over by hand, and see how it is. Shell."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.bus.address import parse_address
from positioner.config.reader import load_config
from positioner.host.terminal import Terminal
from positioner.host.verbs import HELP

if TYPE_CHECKING:
    from positioner.errors import ExitCode

_VERBS = "".join(f"  {line}\n" for line in HELP.splitlines())
_EPILOG = f"""\
verbs, one after another; without any they are read from the standard input, a line each:
{_VERBS}
It sends setpoints from the first verb that needs them until it ends (SIGTERM, Ctrl-C), however long the verbs took:
without them the positioner holds, and later fails safe. `status` and `disarm` alone end by themselves.

examples:
  positioner host --config fv101.toml arm set 62%
  positioner host --config fv101.toml status
  positioner host --config fv101.toml disarm

exit status: 0 done or stopped, 1 a verb could not be done, 2 no such verb, or a number outside what the valve and the
guard allow, 69 the bus is not there, 78 the configuration is wrong.
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        "host",
        help="arm a valve, move it, take over by hand, see how it is",
        description="The host on a valve's bus: arm the positioner, send setpoints or a current, hear of each change.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--config", type=Path, required=True, metavar="FILE", help="configuration of the valve (TOML)")
    parser.add_argument("--bus", metavar="INTERFACE:CHANNEL", help="instead of the configuration's [bus]")
    parser.add_argument("verbs", nargs="*", metavar="VERB", help="arm, disarm, set, manual, auto, status, help")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> ExitCode:
    configuration = load_config(arguments.config)
    if arguments.bus:
        configuration = replace(configuration, bus=parse_address(arguments.bus))
    return Terminal(configuration, arguments.verbs).run()
