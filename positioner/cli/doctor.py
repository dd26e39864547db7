"""`positioner doctor`: problems of this machine, and the commands that solve them. Shell."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from positioner.cli.command import add_command, add_config, add_state
from positioner.cli.tables import add_json, show_json
from positioner.doctor.examination import Examination
from positioner.doctor.finding import Level, worst

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands
    from positioner.errors import ExitCode

_EPILOG = """\
examples:
  positioner doctor                                               this machine and its CAN interfaces
  positioner doctor --config /etc/positioner/fv101.toml           a valve: bus, load, state, daemon, live feedback
  positioner doctor --config /etc/positioner/fv101.toml --json    the same for programs

It changes nothing and sends nothing. Each finding is OK, WARN or FAIL; below a problem follows the
command that solves it, where there is one.

exit status: 0 no finding is FAIL, 1 a finding is FAIL, 78 the configuration is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner doctor`."""
    parser = add_command(
        commands, "doctor", _run, "examine machine, bus and valve, and show how to solve problems", _EPILOG
    )
    add_config(parser, required=False)
    add_state(parser)
    add_json(parser)


def _run(arguments: argparse.Namespace) -> ExitCode:
    examination = Examination(arguments.config, arguments.state)
    for finding in examination.findings():
        if not arguments.json:
            sys.stdout.write(f"{finding}\n")
            sys.stdout.flush()
    if arguments.json:
        show_json(_as_json(examination))
    else:
        sys.stdout.write(f"{_summary(examination)}\n")
    return examination.exit_code


def _as_json(examination: Examination) -> dict[str, object]:
    return {
        "level": worst(examination.found).name,
        "exit_status": int(examination.exit_code),
        "findings": [
            {"level": finding.level.name, "subject": finding.subject, "text": finding.text, "mend": finding.fix}
            for finding in examination.found
        ],
    }


def _summary(examination: Examination) -> str:
    levels = [finding.level for finding in examination.found]
    return f"{levels.count(Level.OK)} OK, {levels.count(Level.WARN)} WARN, {levels.count(Level.FAIL)} FAIL"
