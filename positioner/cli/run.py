"""`positioner run`: the daemon. Shell."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.bus.address import parse_address
from positioner.config.reader import load_config
from positioner.config.schema import StateSettings
from positioner.errors import UsageError
from positioner.machine.journal import set_up
from positioner.machine.memory_lock import lock_memory
from positioner.runtime.daemon import Daemon
from positioner.runtime.session import RunOptions

if TYPE_CHECKING:
    from positioner.errors import ExitCode

_EPILOG = """\
example:
  positioner run --config /etc/positioner/fv101.toml

It waits for the first valid position frame and transmits nothing before it is armed: by a SETPOINT frame with
Request = ARM after one with another request, or at once with guard.auto_arm.
SIGTERM stops it; what it learned is saved first.
exit status: 0 stopped, 69 another controller commands the valve, 71 the system refuses memory, a file or a socket,
74 the table could not be saved, 75 another process holds the valve's state for now, 78 the configuration is wrong, or
the driver of its bus is missing.
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        "run",
        help="control a valve",
        description="Control a valve: read stem-position frames, write 4-20 mA command frames, learn its stiction.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--config", type=Path, required=True, metavar="FILE", help="configuration of the valve (TOML)")
    parser.add_argument(
        "--bus", metavar="INTERFACE:CHANNEL[,OPTION=VALUE...]", help="instead of the configuration's [bus]"
    )
    parser.add_argument("--state", type=Path, metavar="DIR", help="instead of the configuration's state directory")
    parser.add_argument("--dry-run", action="store_true", help="compute and log, but never transmit")
    parser.add_argument("--trace", type=Path, metavar="FILE", help="write one CSV row for each cycle")
    parser.add_argument(
        "--record", type=Path, metavar="FILE", help="log the frames as they were handled, for `positioner replay`"
    )
    parser.add_argument(
        "--clock",
        choices=("realtime", "lockstep"),
        default="realtime",
        help="the machine's clock, or the plant's frames (%(default)s)",
    )
    parser.add_argument("--setpoint-every", type=int, default=0, metavar="N", help=argparse.SUPPRESS)
    parser.add_argument("--verbose", action="store_true", help="log what is learned and why each move begins, too")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> ExitCode:
    if arguments.record and arguments.dry_run:
        raise UsageError("--record tells what was sent, and --dry-run sends nothing: leave one of them out")
    set_up(verbose=arguments.verbose)
    configuration = load_config(arguments.config)
    if arguments.bus:
        configuration = replace(configuration, bus=parse_address(arguments.bus))
    if arguments.state:
        configuration = replace(configuration, state=StateSettings(directory=arguments.state))
    options = RunOptions(
        lockstep=arguments.clock == "lockstep",
        setpoint_every=arguments.setpoint_every,
        dry_run=arguments.dry_run,
        trace=arguments.trace,
        record=arguments.record,
    )
    daemon = Daemon(configuration, options)
    lock_memory()
    return daemon.run()
