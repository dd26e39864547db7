"""`positioner export`: the signals of a recorded bus as CSV, Parquet or MDF 4. Shell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tqdm import tqdm

from positioner.cli.command import add_command, add_config, add_log, add_valve
from positioner.cli.tables import add_json, note, put, show_json
from positioner.config.reader import load_config
from positioner.errors import ExitCode, Problem, UsageError
from positioner.export.formats import FORMATS
from positioner.export.log_rows import LogRows
from positioner.export.signals import Messages
from positioner.replay.log import LogError
from positioner.wire.codec import make_codec
from positioner.wire.foreign import read_messages

if TYPE_CHECKING:
    import argparse

    from positioner.cli.command import Commands

_EPILOG = """\
examples:
  positioner export out/bench/bus.log --to parquet
  positioner export bus.blf --config fv101.toml --out bus.csv
  positioner export bus.log --config fv101.toml --to mf4 --signals 'Position_m,CURRENT_COMMAND'

The log may be candump (.log), ASC, BLF, CSV or another format that python-can reads. A column is named after message,
signal and unit, as in STEM_POSITION/Position_m: in SI units, the loop current in mA. A unit that SI lacks is kept. With
--config the messages are those of the valve, and all others of its own DBC; without it they are ours.

--signals takes names of columns, signals or messages, with * and ?; commas separate them. Capitals count where a name
has any.

exit status: 0 done, 2 wrong command line, 74 the log cannot be read or the file cannot be written, 78 the configuration
is wrong.
"""


def add_parser(commands: Commands) -> None:
    """Add `positioner export`."""
    parser = add_command(
        commands, "export", _run, "write the signals of a recorded bus as CSV, Parquet or MDF 4", _EPILOG
    )
    add_log(parser)
    add_config(parser, required=False)
    add_valve(parser)
    parser.add_argument("--to", choices=tuple(FORMATS), help="format (default: that of --out's name)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to write (default: beside the log, named alike)")
    parser.add_argument("--signals", default="", metavar="NAMES", help="only these signals or messages")
    parser.add_argument(
        "--readable-part", action="store_true", help="of a damaged log, export what is before the damage"
    )
    add_json(parser)


def _run(arguments: argparse.Namespace) -> ExitCode:
    kind, out = _output(arguments)
    messages = _messages(arguments)
    wanted = [each.strip() for each in arguments.signals.split(",") if each.strip()]
    rows = LogRows(arguments.log, messages, wanted, arguments.max_size)
    if rows.log.is_damaged and not arguments.readable_part:
        text = f"{rows.log.cut}; nothing was exported: --readable-part exports what is before it"
        raise LogError(f"{arguments.log}: {text}")
    progress = tqdm(rows, "export", rows.count, unit=" frames", delay=1, leave=False, disable=None)
    FORMATS[kind](out, rows.groups, progress, rows.log.begin_s)
    remarks = [f"ends early: {rows.log.cut}"] if rows.log.cut else []
    remarks += [*rows.left_out.lines(), *messages.left_out]
    for remark in remarks:
        note(f"{arguments.log}: {remark}")
    signals = [signal for group in rows.groups for signal in group.signals]
    if arguments.json:
        columns = [{"column": each.column, "unit": each.unit, "comment": each.meaning} for each in signals]
        left_out = dict(rows.left_out.frames)
        show_json({"file": str(out), "rows": rows.count, "left_out": left_out, "columns": columns})
    else:
        counts = f"{rows.count} frames, {len(rows.groups)} messages, {len(signals)} signals"
        put(f"{out}: {counts}")
    return ExitCode.OK


def _output(arguments: argparse.Namespace) -> tuple[str, Path]:
    """Return the format and the file to write.

    Raises:
        UsageError: they contradict each other, or the file is the log itself.
    """
    named = arguments.out.suffix.lower().removeprefix(".") if arguments.out else ""
    kind = arguments.to or named
    if kind not in FORMATS:
        what = f"the name {arguments.out} says no format" if arguments.out else "no format is given"
        raise UsageError(f"{what}: give --to {' or '.join(FORMATS)}")
    if named in FORMATS and named != kind:
        raise UsageError(f"--to {kind} contradicts --out {arguments.out}")
    out = arguments.out or arguments.log.with_suffix(f".{kind}")
    if out.resolve() == arguments.log.resolve():
        raise UsageError(f"{out} is the log itself: name another file with --out")
    return kind, out


def _messages(arguments: argparse.Namespace) -> Messages:
    if arguments.config is None:
        if arguments.valve:
            raise UsageError("--valve needs --config")
        return Messages(make_codec())
    configuration = load_config(arguments.config, valve=arguments.valve)
    problems: list[Problem] = []
    dbc = configuration.wire.dbc
    return Messages(configuration.make_codec(), read_messages(dbc, problems) if dbc else ())
