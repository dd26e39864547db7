"""`plant-emulator`: the commands, their help, and the exit status of errors. Shell."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from positioner import __version__
from positioner.machine.commands import program_parser, words_given
from positioner.machine.console import Parser, run_command

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

_COMMANDS = ("run", "simulate", "presets")
"""Each is a module of this package, in the order of the help."""
_DESCRIPTION = "A sticking control valve: Karnopp friction, simulated event by event, alone or on a CAN bus."
_EPILOG = """\
examples:
  plant-emulator presets                                           the valves that come with the emulator
  plant-emulator simulate --input triangle --out signature.csv     a valve signature
  plant-emulator run --preset paper --bus socketcan:vcan0          the valve on a bus
  plant-emulator run --config plant.toml                           a valve of your own, with faults: examples/plant.toml

exit status: 0 done, 2 wrong command line, 69 bus not available, 74 result not written, 78 wrong plant or input file
completion:  plant-emulator --completion bash > ~/.local/share/bash-completion/completions/plant-emulator
"""


def build_parser(words: Sequence[str] | None = None) -> Parser:
    """Return the parser with every command, or with what the `words` of a command line need."""
    return program_parser("plant-emulator", __version__, (_DESCRIPTION, _EPILOG), __package__, _COMMANDS, words)


def prepared(arguments: list[str] | None = None) -> Callable[[], int]:
    """Load what the command line needs; return what runs it and returns its exit status."""
    parser = build_parser(words_given(arguments))
    return lambda: run_command(parser, arguments)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return prepared(arguments)()


if __name__ == "__main__":
    sys.exit(main())
