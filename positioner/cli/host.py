"""`positioner host`: arm a valve, move it, give its current by hand, show its status. Shell."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from positioner.bus.address import parse_address
from positioner.cli.command import add_command, add_config, add_valve
from positioner.cli.tables import add_json, show_json
from positioner.config.reader import load_config
from positioner.errors import ExitCode, UsageError
from positioner.host.interactive import Interactive
from positioner.host.screen import is_usable
from positioner.host.terminal import Terminal
from positioner.host.verbs import HELP, Word
from positioner.machine.completion import suggest

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands

_VERBS = "".join(f"  {line}\n" for line in HELP.splitlines())
_EPILOG = f"""\
Verbs are done one after another:
{_VERBS}
Without verbs it is a session: in a terminal keys act at once (arrows step the setpoint, m manual, a auto, q quit, : and
a verb), with the status live below; from a pipe or a file a verb is read from each line.

It sends setpoints from the first verb that needs them until it ends (SIGTERM, Ctrl-C): without setpoints the positioner
holds, and later it fails safe. `status` and `disarm` alone end by themselves, and so does a profile that stands last.

examples:
  positioner host --config fv101.toml arm set 62%
  positioner host --config fv101.toml
  positioner host --config fv101.toml arm profile steps.csv repeat 3 disarm
  positioner host --config fv101.toml status
  positioner host --config fv101.toml --json status
  positioner host --config fv101.toml disarm
  positioner host --config two-valves.toml --valve FV-102 arm set 40%

exit status: 0 done or stopped, 1 a verb could not be done, 2 an unknown verb, or a number outside the limits of the
valve and the guard, 69 the bus is not available, 78 the configuration or the file of a profile is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner host`."""
    parser = add_command(
        commands, "host", _run, "arm a valve, move it, give its current by hand, show its status", _EPILOG
    )
    add_config(parser)
    add_valve(parser)
    parser.add_argument("--bus", metavar="INTERFACE:CHANNEL", help="bus instead of the configuration's")
    add_json(parser)
    verbs = parser.add_argument("verbs", nargs="*", metavar="VERB", help=", ".join(Word))
    suggest(verbs, lambda: (*Word, "repeat"), "*.csv")


def _run(arguments: argparse.Namespace) -> ExitCode:
    configuration = load_config(arguments.config, valve=arguments.valve)
    if arguments.bus:
        configuration = replace(configuration, bus=parse_address(arguments.bus))
    if arguments.json:
        if arguments.verbs != [Word.STATUS]:
            raise UsageError("--json goes with the verb `status` alone")
        show_json(Terminal(configuration, arguments.verbs).status())
        return ExitCode.OK
    if not arguments.verbs and is_usable():
        return Interactive(configuration).run()
    return Terminal(configuration, arguments.verbs).run()
