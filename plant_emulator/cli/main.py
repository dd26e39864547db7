# PYTHON_ARGCOMPLETE_OK
"""`plant-emulator`: the commands, their help, and how errors end. Shell."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

import argcomplete

from plant_emulator.cli import presets, run, simulate
from positioner import __version__
from positioner.errors import ExitCode, PositionerError

if TYPE_CHECKING:
    from collections.abc import Callable

_DESCRIPTION = "A sticking control valve: Karnopp friction, simulated event by event, alone or on a CAN bus."
_EPILOG = """\
examples:
  plant-emulator presets                                           the valves that come with the emulator
  plant-emulator simulate --input triangle --out signature.csv     a valve signature
  plant-emulator run --preset paper --bus socketcan:vcan0          the valve on a bus

exit status: 0 done, 2 usage, 69 bus not available, 74 result not written, 78 plant or input file
completion:  eval "$(register-python-argcomplete plant-emulator)"
"""
_INTERRUPTED = 130
"""128 + SIGINT, as shells count it."""


def build_parser() -> argparse.ArgumentParser:
    """Return the parser with every command."""
    parser = argparse.ArgumentParser(
        prog="plant-emulator",
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"plant-emulator {__version__}")
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in (run, simulate, presets):
        command.add_parser(subparsers)
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = build_parser()
    argcomplete.autocomplete(parser)
    parsed = parser.parse_args(arguments)
    command: Callable[[argparse.Namespace], ExitCode] = parsed.run
    try:
        return int(command(parsed))
    except PositionerError as error:
        sys.stderr.write(f"plant-emulator: {error}\n")
        return int(error.exit_code)
    except KeyboardInterrupt:
        return _INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()  # the reader has gone; nobody is left to tell
        return int(ExitCode.OK)


if __name__ == "__main__":
    sys.exit(main())
