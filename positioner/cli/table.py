"""`positioner table`: print, reset, export or import the stiction table, while the daemon runs or not. Shell."""

from __future__ import annotations

import csv
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from positioner.cli import table_text
from positioner.cli.command import add_valve
from positioner.cli.question import agreed
from positioner.cli.tables import note, put, show
from positioner.config.locations import location_of
from positioner.errors import ExitCode, StateError
from positioner.store import access, document
from positioner.valve.stiction import Quantity

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from positioner.config.schema import Configuration
    from positioner.store.content import StoredTable


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `table` and its four commands."""
    parser = subparsers.add_parser(
        "table",
        help="print, reset, export or import the stiction table",
        description="The stiction table: what was learned from past sticks and slips, by position and direction.",
        epilog="exit status: 0 done, 2 wrong command line, 74 a table or file cannot be used, 78 the configuration is "
        "wrong.",
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    command = _command(commands, "dump", _dump, "print the table", "positioner table dump --config valve.toml")
    formats = command.add_mutually_exclusive_group()
    formats.add_argument(
        "--format", choices=("table", "markdown", "json", "csv"), default="table", help="format (default: %(default)s)"
    )
    for name in ("json", "markdown"):
        text = f"the same as --format {name}"
        formats.add_argument(f"--{name}", dest="format", action="store_const", const=name, help=text)
    names = tuple(str(quantity) for quantity in Quantity)
    command.add_argument("--quantity", choices=names, help="only this quantity (default: all)")

    command = _command(
        commands, "reset", _reset, "empty the table, after a backup", "positioner table reset --state DIR"
    )
    command.add_argument("--yes", action="store_true", help="do not ask")

    example = "positioner table export FV-101.json --config valve.toml"
    command = _command(commands, "export", _export, "write the table to a JSON file", example)
    command.add_argument("file", metavar="FILE", type=Path, help="a new file")

    example = "positioner table import FV-101.json --config valve.toml"
    command = _command(commands, "import", _import, "replace the table, after a backup, by an exported one", example)
    command.add_argument("file", metavar="FILE", type=Path, help="an export or a backup")
    command.add_argument("--force", action="store_true", help="accept the table of another valve")


def _command(
    commands: argparse._SubParsersAction[argparse.ArgumentParser],
    name: str,
    run: Callable[[argparse.Namespace], ExitCode],
    purpose: str,
    example: str,
) -> argparse.ArgumentParser:
    description = f"{purpose[0].upper()}{purpose[1:]}."
    command = commands.add_parser(name, help=purpose, description=description, epilog=f"example: {example}")
    place = command.add_mutually_exclusive_group(required=True)
    place.add_argument("--state", metavar="DIR", type=Path, help="the valve's state directory")
    place.add_argument("--config", metavar="FILE", type=Path, help="configuration of the valve: it has the directory")
    add_valve(command)
    command.set_defaults(run=run)
    return command


def _dump(args: argparse.Namespace) -> ExitCode:
    stored = access.dump(_directory(args))
    if args.quantity:
        stored = _only(stored, Quantity(args.quantity))
    if args.format == "json":
        sys.stdout.write(document.dumps(stored))
    elif args.format == "csv":
        csv.writer(sys.stdout, lineterminator="\n").writerows(table_text.csv_rows(stored))
    else:
        show(table_text.blocks(stored), as_markdown=args.format == "markdown")
    return ExitCode.OK


def _reset(args: argparse.Namespace) -> ExitCode:
    directory = _directory(args)
    nobody = StateError("reset asks before it empties the table, and there is no terminal to ask on; give --yes")
    if not args.yes and not agreed(f"Empty the table? {table_text.summary(access.dump(directory))}", nobody):
        note("nothing was changed")
        return ExitCode.USAGE
    _report("the table is empty now", access.reset(directory), directory)
    return ExitCode.OK


def _export(args: argparse.Namespace) -> ExitCode:
    stored = access.dump(_directory(args))
    try:
        with args.file.open("x", encoding="utf-8") as file:
            file.write(document.dumps(stored))
    except FileExistsError as error:
        raise StateError(f"{args.file}: exists already; choose another name") from error
    except OSError as error:
        raise StateError(f"{args.file}: cannot be written: {error.strerror}") from error
    put(f"{table_text.summary(stored)}: written to {args.file}")
    return ExitCode.OK


def _import(args: argparse.Namespace) -> ExitCode:
    try:
        text = args.file.read_text(encoding="utf-8")
    except OSError as error:
        raise StateError(f"{args.file}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise StateError(f"{args.file}: is not UTF-8 text: {error}") from error
    stored = document.loads(text, str(args.file))
    if args.config:
        stored = _fitted(stored, _configuration(args), force=args.force)
    directory = _directory(args)
    backup = access.replace(directory, stored, force=args.force)
    _report(f"{table_text.summary(stored)}: imported", backup, directory)
    return ExitCode.OK


def _directory(args: argparse.Namespace) -> Path:
    return args.state or location_of(_configuration(args), args.config).state


def _configuration(args: argparse.Namespace) -> Configuration:
    from positioner.config.reader import load_config  # noqa: PLC0415, with --state neither numpy nor a solver is needed

    return load_config(args.config, valve=args.valve)


def _fitted(stored: StoredTable, configuration: Configuration, *, force: bool) -> StoredTable:
    """Return the table for the configured valve; an empty state directory could not check that they fit together.

    Raises:
        StateError: the table is another valve's, or its cells have another width.
    """
    valve_id, width_m = configuration.valve.id, configuration.control.table_cell_m
    if stored.valve_id != valve_id and not force:
        raise StateError(f"the table is of valve {stored.valve_id!r}, the configuration's is {valve_id!r}; see --force")
    if stored.table.cell_width_m != width_m:
        found = f"cells of {stored.table.cell_width_m:g} m, the configuration's are {width_m:g} m wide"
        raise StateError(f"the table has {found}: it cannot be converted")
    return replace(stored, valve_id=valve_id)


def _only(stored: StoredTable, quantity: Quantity) -> StoredTable:
    cells = MappingProxyType({key: cell for key, cell in stored.table if key.quantity is quantity})
    return replace(stored, table=replace(stored.table, cells=cells))


def _report(done: str, backup: str | None, directory: Path) -> None:
    put(done)
    if backup:
        restore = shlex.join(["positioner", "table", "import", backup, "--state", str(directory)])
        put(f"the former table is in {backup}; to restore it:\n  {restore}")
