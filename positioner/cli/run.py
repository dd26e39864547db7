"""`positioner run`: the daemon. Shell."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.bus.address import parse_address
from positioner.cli.command import add_command, add_config, add_state
from positioner.config.reader import load_valves
from positioner.config.schema import StateSettings
from positioner.errors import UsageError
from positioner.laws.outside import OutsideLaw
from positioner.machine.journal import set_up
from positioner.machine.memory_lock import lock_memory
from positioner.runtime.daemon import Daemon
from positioner.runtime.session import RunOptions
from positioner.runtime.warm_up import warm_up

if TYPE_CHECKING:
    from positioner.cli.command import Commands
    from positioner.errors import ExitCode

_EPILOG = """\
example:
  positioner run --config /etc/positioner/fv101.toml

It waits for the first valid position frame and commands nothing before it is armed. A host arms it with a SETPOINT
frame whose request changes to ARM; with guard.auto_arm it arms itself.
SIGTERM stops it; what it has learned is saved before it ends.
A law of yours, control.law = "my_law.py:MyLaw", runs behind the same guard (docs/own-law.md); the log says so.

exit status: 0 stopped, 69 another controller commands the valve, 71 the system refuses memory, a file or a socket,
74 the table could not be saved, 75 another process holds the valve's state for now, 78 the configuration is wrong, or
the driver of its bus is missing.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner run`."""
    parser = add_command(
        commands, "run", _run, "control a valve: read positions, write 4-20 mA commands, learn its stiction", _EPILOG
    )
    add_config(parser)
    parser.add_argument(
        "--bus", metavar="INTERFACE:CHANNEL[,OPTION=VALUE...]", help="bus instead of the configuration's"
    )
    add_state(parser)
    parser.add_argument("--dry-run", action="store_true", help="compute and log, but never transmit")
    parser.add_argument("--trace", type=Path, metavar="FILE", help="write one CSV row for each cycle")
    parser.add_argument("--record", type=Path, metavar="FILE", help="record every cycle for `positioner replay`")
    parser.add_argument(
        "--clock",
        choices=("realtime", "lockstep"),
        default="realtime",
        help="realtime: the machine's clock; lockstep: one period for each position frame (default: %(default)s)",
    )
    parser.add_argument("--setpoint-every", type=int, default=0, metavar="N", help=argparse.SUPPRESS)
    parser.add_argument("--verbose", action="store_true", help="also log what is learned and why each move begins")


def _run(arguments: argparse.Namespace) -> ExitCode:
    if arguments.record and arguments.dry_run:
        raise UsageError("--record stores the frames that are sent, and --dry-run sends none: leave one of them out")
    set_up(verbose=arguments.verbose)
    configurations = load_valves(arguments.config)
    if arguments.bus:
        if len({configuration.bus.place for configuration in configurations}) > 1:
            raise UsageError("--bus gives one bus, and this configuration has several: change it there")
        bus = parse_address(arguments.bus)
        configurations = tuple(replace(configuration, bus=bus) for configuration in configurations)
    if arguments.state:
        state = StateSettings(directory=arguments.state)
        configurations = tuple(replace(configuration, state=state) for configuration in configurations)
    options = RunOptions(
        lockstep=arguments.clock == "lockstep",
        setpoint_every=arguments.setpoint_every,
        dry_run=arguments.dry_run,
        trace=arguments.trace,
        record=arguments.record,
    )
    daemon = Daemon(configurations, options)
    for session in daemon.sessions:
        if isinstance(session.setup.law, OutsideLaw):
            session.announcer.log.warning("%s", session.setup.law.in_words())
    for session, configuration in zip(daemon.sessions, configurations, strict=False):
        for line in configuration.retired:
            session.announcer.log.warning("%s", line)
    lock_memory()
    for configuration in configurations:
        warm_up(configuration)
    return daemon.run()
