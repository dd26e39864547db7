"""`positioner monitor`: watch valves live, or in a log, in a terminal or a browser; it listens only. Shell."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.bus.address import parse_address
from positioner.cli.command import add_command, add_config, add_max_size, add_valve
from positioner.cli.tables import put
from positioner.config.locations import location_of
from positioner.config.reader import load_valves
from positioner.errors import ExitCode, UsageError, writing
from positioner.inputs.nearest import check_name
from positioner.monitor.live import LiveSource
from positioner.monitor.recorded import RecordedSource
from positioner.monitor.web import PORT, serve

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from positioner.cli.command import Commands
    from positioner.config.schema import Configuration
    from positioner.monitor.source import Source

INSTALL = "textual is not installed: pip install 'sticking-valve-positioner[monitor]'; --web needs nothing"
_EPILOG = """\
It listens only: it never sends a frame, and control goes on as without it. Keys: q quits, space pauses, ? helps.

examples:
  positioner monitor --config fv101.toml
  positioner monitor --config two-valves.toml --valve FV-102
  positioner monitor bus.log --config fv101.toml --speed 0.1
  positioner monitor bus.log --config fv101.toml --picture end.svg
  positioner monitor --config fv101.toml --web --port 8700

exit status: 0 quit, 2 no such valve, or no terminal, 69 the bus is not available, 74 the log cannot be read, 78 the
configuration is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner monitor`."""
    parser = add_command(
        commands, "monitor", _run, "watch valves live on their bus, or in a log; it listens only", _EPILOG
    )
    parser.add_argument("log", nargs="?", type=Path, metavar="LOG", help="a recorded bus, in place of the live one")
    add_max_size(parser)
    add_config(parser)
    add_valve(parser)
    parser.add_argument("--bus", metavar="INTERFACE:CHANNEL", help="bus instead of the configuration's")
    parser.add_argument(
        "--web", action="store_true", help="show it in a browser of this machine instead of the terminal"
    )
    parser.add_argument(
        "--port", type=int, default=PORT, metavar="N", help="port of the page (default: %(default)s; 0: any free one)"
    )
    parser.add_argument(
        "--picture", type=Path, metavar="FILE.svg", help="draw what the view shows at the end of a log, and end"
    )
    parser.add_argument(
        "--speed",
        type=float,
        default=1.0,
        metavar="X",
        help="how fast a log plays; 2: twice as fast (default: %(default)s)",
    )


def _run(arguments: argparse.Namespace) -> ExitCode:
    configurations = load_valves(arguments.config)
    if arguments.valve is not None:
        check_name("valve", arguments.valve, tuple(each.valve.id for each in configurations))
    if arguments.bus:
        if len({configuration.bus.place for configuration in configurations}) > 1:
            raise UsageError("--bus gives one bus, and this configuration has several: change it there")
        address = parse_address(arguments.bus)
        configurations = tuple(replace(configuration, bus=address) for configuration in configurations)
    if arguments.web:
        _watch(_source(arguments, configurations), lambda source: serve(source, arguments.port, arguments.valve, _tell))
        return ExitCode.OK
    if arguments.picture and not arguments.log:
        raise UsageError("--picture draws the end of a log: give a LOG")
    if not arguments.picture and not (sys.stdin and sys.stdin.isatty() and sys.stdout.isatty()):
        raise UsageError("monitor draws on a terminal, and there is none here; see --web, or `positioner host status`")
    try:
        from positioner.monitor.terminal import picture, run  # noqa: PLC0415 - only here, and an extra
    except ImportError as error:
        raise UsageError(INSTALL) from error
    if arguments.picture:
        with writing(arguments.picture):
            _watch(
                _source(arguments, configurations),
                lambda source: arguments.picture.write_text(picture(source, arguments.valve), encoding="utf-8"),
            )
        return ExitCode.OK
    _watch(_source(arguments, configurations), lambda source: run(source, arguments.valve))
    return ExitCode.OK


def _watch(source: Source, show: Callable[[Source], object]) -> None:
    """Show a source, which is filled meanwhile."""
    source.start()
    try:
        show(source)
    finally:
        source.close()


def _tell(address: str) -> None:
    put(f"{address}  (for browsers on this machine; Ctrl-C ends it)")
    sys.stdout.flush()


def _source(arguments: argparse.Namespace, configurations: tuple[Configuration, ...]) -> Source:
    """Return the log, or the bus.

    Raises:
        UsageError: the log is to play at no speed.
        LogError: the log cannot be read.
    """
    if arguments.log is None:
        states = {each.valve.id: location_of(each, arguments.config).state for each in configurations}
        return LiveSource(configurations, states)
    if not arguments.speed > 0.0:
        raise UsageError(f"--speed {arguments.speed:g}: must be positive")
    source = RecordedSource(configurations, arguments.log, arguments.max_size)
    source.play_at(arguments.speed)
    return source
