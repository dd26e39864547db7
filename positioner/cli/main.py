# PYTHON_ARGCOMPLETE_OK
"""`positioner`: the commands, their help, and how errors end. Shell."""

from __future__ import annotations

import argparse
import sys

import positioner
from positioner.cli import bench, check, conformance, doctor, host, league, replay, reproduce, run, table, tune
from positioner.inputs.parser import Parser
from positioner.machine.console import run_command

_DESCRIPTION = "A positioner for sticking control valves: predictive control with a learned stiction table, over CAN."
_EPILOG = """\
examples:
  positioner bench                                the loop closed with an emulated valve, no hardware needed
  positioner check /etc/positioner/fv101.toml     every mistake of a configuration at once
  positioner doctor                               what stands in the way on this machine
  positioner run --config fv101.toml              control the valve
  positioner host --config fv101.toml arm set 62% let it, and move the valve to 62 %
  positioner replay bus.log --config fv101.toml   do a recorded bus again, and compare
  positioner table dump --config fv101.toml       what was learned about its stiction

exit status: 0 done, 1 failed, 2 usage, 69 bus or valve not available, 70 internal error, 71 the system refuses,
             74 state not saved, 75 occupied for now, 78 configuration
completion:  eval "$(register-python-argcomplete positioner)"
"""


def build_parser() -> Parser:
    """Return the parser with every command."""
    parser = Parser(
        prog="positioner",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"positioner {positioner.__version__}")
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in (run, host, bench, replay, league, reproduce, tune, table, check, doctor, conformance):
        command.add_parser(subparsers)
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return run_command(build_parser(), arguments)


if __name__ == "__main__":
    sys.exit(main())
