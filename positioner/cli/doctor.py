"""`positioner doctor`: what stands in a positioner's way on this machine, and the command that mends it. Shell."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.doctor.examination import Examination
from positioner.doctor.finding import Level, worst

if TYPE_CHECKING:
    from positioner.errors import ExitCode

_EPILOG = """\
examples:
  positioner doctor                                               this machine and its CAN interfaces
  positioner doctor --config /etc/positioner/fv101.toml           a valve: bus, load, state, daemon, live feedback
  positioner doctor --config /etc/positioner/fv101.toml --json    the same for programs

It changes nothing and sends nothing. Each finding is OK, WARN or FAIL, with the command that mends it below.
exit status: 0 nothing failed, 1 something did, 78 the configuration is wrong.
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        "doctor",
        help="examine machine, bus and valve, and say what mends them",
        description="Examine this machine, and with a configuration its bus, state, daemon and live feedback.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--config", type=Path, metavar="FILE", help="the configuration of a valve (TOML)")
    parser.add_argument("--state", type=Path, metavar="DIR", help="instead of the configuration's state directory")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of lines")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> ExitCode:
    examination = Examination(arguments.config, arguments.state)
    for finding in examination.findings():
        if not arguments.json:
            sys.stdout.write(f"{finding}\n")
            sys.stdout.flush()
    if arguments.json:
        sys.stdout.write(json.dumps(_as_json(examination), indent=2, ensure_ascii=False) + "\n")
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
    return f"{levels.count(Level.OK)} fine, {levels.count(Level.WARN)} to look at, {levels.count(Level.FAIL)} failed"
