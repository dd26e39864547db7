"""`positioner`: the list of its commands, and its help. Shell."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import positioner
from positioner.machine.commands import program_parser, words_given
from positioner.machine.console import Parser, run_command

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

_COMMANDS = (
    "run",
    "host",
    "monitor",
    "identify",
    "signature",
    "step-test",
    "stroke-test",
    "bench",
    "replay",
    "explain",
    "export",
    "league",
    "campaign",
    "reproduce",
    "robustness",
    "tune",
    "table",
    "check",
    "reach",
    "diagnose",
    "report",
    "health",
    "doctor",
    "conformance",
)
"""Each is a module of this package, in the order of the help."""
_DESCRIPTION = "A positioner for sticking control valves: predictive control with a learned stiction table, over CAN."
_EPILOG = """\
examples:
  positioner bench                                 control an emulated valve; no hardware needed
  positioner check /etc/positioner/fv101.toml      report all mistakes of a configuration at once
  positioner doctor                                report the problems of this machine
  positioner run --config fv101.toml               control the valve
  positioner host --config fv101.toml arm set 62%  arm the positioner, and move the valve to 62 %
  positioner replay bus.log --config fv101.toml    compute recorded commands again, and compare
  positioner export bus.log --to parquet           write every signal of a recorded bus for other programs
  positioner identify --config fv101.toml          measure spring, friction and lag of the valve
  positioner stroke-test --config fv101.toml       stroke the valve by a tenth, and tell whether it moves as it should
  positioner step-test --config fv101.toml         measure response times, dead band and resolution
  positioner diagnose loop.csv                     tell from OP and PV of a loop whether its valve sticks
  positioner report --config fv101.toml            write one page about the valve, for the screen and for paper
  positioner health --config fv101.toml            show counters, trends and alarms of the valve
  positioner table dump --config fv101.toml        print what was learned about the valve's stiction

exit status: 0 done, 1 failed, 2 wrong command line, 65 what was measured does not fit the model, 69 bus or valve not
             available, 70 internal error, 71 the system refuses, 74 state not saved, 75 in use by another process for
             now, 78 wrong configuration
completion:  positioner --completion bash > ~/.local/share/bash-completion/completions/positioner
"""


def build_parser(words: Sequence[str] | None = None) -> Parser:
    """Return the parser with every command, or with what the `words` of a command line need."""
    return program_parser("positioner", positioner.__version__, (_DESCRIPTION, _EPILOG), __package__, _COMMANDS, words)


def prepared(arguments: list[str] | None = None) -> Callable[[], int]:
    """Load what the command line needs; return what runs it and returns its exit status."""
    parser = build_parser(words_given(arguments))
    return lambda: run_command(parser, arguments)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    return prepared(arguments)()


if __name__ == "__main__":
    sys.exit(main())
