"""`positioner diagnose`: whether a valve sticks, from a log of its frames or from OP and PV of any loop. Shell."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.cli.command import add_command, add_config, add_log, add_valve, check_picture, numbers_in
from positioner.cli.tables import add_output, below, note, show, show_json
from positioner.config.reader import load_config
from positioner.diagnostics.finding import finding_of, percent
from positioner.diagnostics.loop_table import OPTIONS, LoopTable, loop_of
from positioner.diagnostics.report import (
    METHOD_HEAD,
    answer_row,
    as_values,
    direct_lines,
    indirect_lines,
    notes,
    size_rows,
    verdict_line,
)
from positioner.diagnostics.verdict import Verdict
from positioner.errors import ExitCode, UsageError, writing
from positioner.inputs.csv_table import table_in
from positioner.report.table import Table

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    import numpy as np
    from numpy.typing import NDArray

    from positioner.cli.command import Commands
    from positioner.diagnostics.finding import Finding
    from positioner.report.text import Block

_EPILOG = """\
examples:
  positioner diagnose bus.log --config fv101.toml           from command and stem position of a log or record
  positioner diagnose fic101.csv                            from OP and PV of any loop, columns by their names
  positioner diagnose fic101.csv --op OUT --pv FLOW --sp SET --picture fic101.png
  positioner diagnose fic101.csv --op 2 --pv 3 --period 5   without a header and without times
  positioner diagnose fic101.csv --stem ZT101 --json        with the position of the stem, for programs
  positioner diagnose fic101.csv --report fic101.html       one page: verdict, signals, every method

S and J are in percent of the command's span. From OP and PV alone the published methods stand side by side; the verdict
is "yes" where two of HAMM, ADD, YAM and CORR agree, one of them with a model of the valve, "no" where none of them says
yes and OP moved by more than 1.4 %, else "undecided": a valve that rests shows nothing. The transients after setpoint
steps are left out. "No stiction" does not mean that a loop is healthy.

exit status: 0 no stiction found, or undecided, 1 the valve sticks, 2 wrong command line, or a column is not named
clearly, 74 the log cannot be read, or holds too little, 78 the configuration is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner diagnose`."""
    parser = add_command(commands, "diagnose", _run, "tell from a log whether a valve sticks, and how much", _EPILOG)
    add_log(parser, "CSV of a loop, or with --config a recorded bus")
    add_config(parser, required=False)
    add_valve(parser)
    meanings = {
        "op": "controller output",
        "pv": "process value",
        "sp": "setpoint",
        "time": "time stamps",
        "stem": "stem position",
    }
    for role, option in OPTIONS.items():
        parser.add_argument(option, dest=role, metavar="COLUMN", help=f"column of the {meanings[role]}")
    parser.add_argument("--period", type=float, metavar="S", help="sample period, where there are no time stamps")
    parser.add_argument("--op-range", default="0,100", metavar="A,B", help="OP at 0 and 100 %% (default: %(default)s)")
    add_output(parser)
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw the trend and the evidence (PNG and SVG)")
    parser.add_argument("--report", type=Path, metavar="FILE", help="write the finding as an HTML page")


def _run(arguments: argparse.Namespace) -> ExitCode:
    check_picture(arguments.picture)
    if arguments.config:
        from positioner.replay.stem_log import CURRENT_AT_0_MA, CURRENT_AT_100_MA  # noqa: PLC0415 - see _table

        low, high = CURRENT_AT_0_MA, CURRENT_AT_100_MA
    else:
        low, high = _op_range(arguments.op_range)
    if arguments.period is not None and not 0.0 < arguments.period < 1e9:  # noqa: PLR2004
        raise UsageError(f"--period {arguments.period:g} is no period: give seconds above 0")
    table = _table(arguments)
    finding = finding_of(str(arguments.log), table, low, high)
    if arguments.json:
        show_json(as_values(finding))
    else:
        show(_blocks(finding), as_markdown=arguments.markdown)
    if arguments.report:
        _write_report(arguments.report, finding, table, percent(table.op, low, high))
    if arguments.picture:
        from positioner.cli.diagnose_picture import draw  # noqa: PLC0415 - matplotlib would slow every command down

        draw(arguments.picture, table, finding, percent(table.op, low, high))
        note(f"picture: {arguments.picture}")
    return ExitCode.FAILURE if finding.verdict is Verdict.YES else ExitCode.OK


def _blocks(finding: Finding) -> Iterator[Block]:
    """Yield the verdict, S and J, the evidence, and what the methods on OP and PV answer."""
    yield verdict_line(finding)
    sizes = size_rows(finding)
    if sizes:
        yield ""
        yield Table.of(("of the command", "value, %", "95 % interval"), sizes)
    if finding.direct:
        yield from below(direct_lines(finding.direct))
    if finding.indirect:
        yield from below(indirect_lines(finding.indirect, finding))
        yield ""
        yield Table.of(METHOD_HEAD, map(answer_row, finding.indirect.answers))
    yield from below(f"note: {note}" for note in notes(finding))


def _write_report(path: Path, finding: Finding, table: LoopTable, command: NDArray[np.float64]) -> None:
    from positioner.report.diagnosis_page import diagnosis_page  # noqa: PLC0415 - Jinja2 for a report only
    from positioner.report.page import html  # noqa: PLC0415

    with writing(path):
        path.write_text(html(diagnosis_page(finding, table, command, datetime.now(UTC))), encoding="utf-8")
    note(f"report: {path}")


def _table(arguments: argparse.Namespace) -> LoopTable:
    """Return the loop in a CSV file, or with a configuration that in the log of a bus.

    Raises:
        RecordError: the file cannot be read.
    """
    if arguments.config:
        from positioner.replay.stem_log import stem_table  # noqa: PLC0415 - a log library, for a log only

        return stem_table(arguments.log, load_config(arguments.config, valve=arguments.valve), arguments.max_size)
    table = table_in(arguments.log, ", or a bus log with --config", arguments.max_size)
    return loop_of(table, {role: getattr(arguments, role) for role in OPTIONS}, arguments.period)


def _op_range(given: str) -> tuple[float, float]:
    """Return OP at 0 and at 100 %.

    Raises:
        UsageError: they are not two different numbers.
    """
    numbers = numbers_in("--op-range", given)
    if len(numbers) != 2 or numbers[0] == numbers[1]:  # noqa: PLR2004
        raise UsageError(f"--op-range {given!r}: give OP at 0 and at 100 %, like 4,20")
    return numbers[0], numbers[1]
