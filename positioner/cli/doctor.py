"""`positioner doctor`: problems of this machine, and the commands that solve them. Shell."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from tqdm import tqdm

from positioner.cli.command import add_command, add_config, add_state
from positioner.cli.tables import add_output, show, show_json
from positioner.doctor.examination import Examination
from positioner.doctor.finding import Level, summary, worst
from positioner.report.table import Table

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    from positioner.cli.command import Commands
    from positioner.errors import ExitCode
    from positioner.report.text import Block

_EPILOG = """\
examples:
  positioner doctor                                               this machine and its CAN interfaces
  positioner doctor --config /etc/positioner/fv101.toml           a valve: bus, load, state, daemon, live feedback
  positioner doctor --config /etc/positioner/fv101.toml --json    the same for programs

It changes nothing and sends nothing. Each finding is OK, WARN or FAIL; below them follow the commands that solve the
problems.

exit status: 0 no finding is FAIL, 1 a finding is FAIL, 78 the configuration is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner doctor`."""
    parser = add_command(
        commands, "doctor", _run, "examine machine, bus and valve, and show how to solve problems", _EPILOG
    )
    add_config(parser, required=False)
    add_state(parser)
    add_output(parser)


def _run(arguments: argparse.Namespace) -> ExitCode:
    examination = Examination(arguments.config, arguments.state)
    for _ in tqdm(examination.findings(), "doctor", unit=" findings", delay=1, leave=False, disable=None):
        pass
    if arguments.json:
        show_json(_as_json(examination))
    else:
        show(_blocks(examination), as_markdown=arguments.markdown)
    return examination.exit_code


def _blocks(examination: Examination) -> Iterator[Block]:
    """Yield how many findings are how serious, each of them, and the commands that solve problems."""
    found = examination.found
    yield summary(found)
    yield ""
    rows = [(finding.level.name, finding.subject, finding.text) for finding in found]
    problems = frozenset(number for number, each in enumerate(found) if each.level is Level.FAIL)
    yield replace(Table.of(("level", "subject", "finding"), rows, names=2), marked=problems)
    for finding in found:
        if finding.fix:
            yield ""
            yield f"{finding.level.name} {finding.subject}, fix:"
            yield f"  `{finding.fix}`"


def _as_json(examination: Examination) -> dict[str, object]:
    return {
        "level": worst(examination.found).name,
        "exit_status": int(examination.exit_code),
        "findings": [
            {"level": finding.level.name, "subject": finding.subject, "text": finding.text, "mend": finding.fix}
            for finding in examination.found
        ],
    }
