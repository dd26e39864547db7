"""How a command is added to the command line, and the options that several commands share. Pure."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from positioner.errors import UsageError
from positioner.inputs.plain_file import MOST_MIB

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.errors import ExitCode
    from positioner.studies.pool import Workers

    Commands: TypeAlias = argparse._SubParsersAction[argparse.ArgumentParser]  # noqa: SLF001 - argparse names no type

_HIGHEST_MIB = 1 << 24


def add_command(
    commands: Commands,
    name: str,
    run: Callable[[argparse.Namespace], ExitCode] | None,
    summary: str,
    epilog: str,
) -> argparse.ArgumentParser:
    """Return the parser of a new command, whose epilog has examples and exit statuses.

    Without `run` it is a group of commands.
    """
    description = f"{summary[0].upper()}{summary[1:]}."
    parser = commands.add_parser(
        name,
        help=summary,
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
    return parser


def add_config(parser: argparse.ArgumentParser, *, required: bool = True) -> None:
    """Add `--config`."""
    parser.add_argument("--config", type=Path, required=required, metavar="FILE", help="configuration of the valve")


def add_valve(parser: argparse.ArgumentParser) -> None:
    """Add `--valve`."""
    parser.add_argument("--valve", metavar="ID", help="which valve is meant, where the configuration has several")


def add_state(parser: argparse.ArgumentParser, text: str = "state directory instead of the configuration's") -> None:
    """Add `--state`."""
    parser.add_argument("--state", type=Path, metavar="DIR", help=text)


def add_log(parser: argparse.ArgumentParser, text: str = "the recorded bus") -> None:
    """Add the argument LOG, and `--max-size`."""
    parser.add_argument("log", type=Path, metavar="LOG", help=text)
    add_max_size(parser)


def add_max_size(parser: argparse.ArgumentParser) -> None:
    """Add `--max-size`, of commands that read a log."""
    parser.add_argument(
        "--max-size",
        type=_mib,
        default=MOST_MIB,
        metavar="MIB",
        help="memory that reading the log may take, in MiB (default: %(default)s)",
    )


def _mib(given: str) -> int:
    if not given.isdecimal() or not 0 < int(given[:9]) < _HIGHEST_MIB:
        raise argparse.ArgumentTypeError(f"{given!r} is no number of MiB, such as 1024")
    return int(given)


def add_study(parser: argparse.ArgumentParser, folder: Path) -> None:
    """Add `--workers` and `--dask`, and `--out` with the default `folder`."""
    add_workers(parser)
    parser.add_argument(
        "--out", type=Path, default=folder, metavar="DIR", help="output directory (default: %(default)s)"
    )


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add `--workers` and `--dask`, which exclude each other; `workers_of` reads them."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, metavar="N", help="number of processes (default: one for each core)")
    where.add_argument("--dask", metavar="ADDRESS", help="the scheduler of a Dask cluster, like tcp://192.0.2.1:8786")


def workers_of(arguments: argparse.Namespace) -> Workers:
    """Return where the study of this command line runs."""
    from positioner.studies.pool import Workers  # noqa: PLC0415 - most commands are no studies

    return Workers(arguments.workers, arguments.dask)


def refuse_without_folder(option: str, path: Path | None) -> None:
    """Refuse a file that will be written where there is no folder for it; None is fine.

    Raises:
        UsageError: there is none.
    """
    if path is not None and not path.absolute().parent.is_dir():
        raise UsageError(f"{option} {path}: there is no folder {path.absolute().parent}")


def check_picture(path: Path | None) -> None:
    """Refuse a `--picture` that cannot be written, before anything moves; None is fine.

    Raises:
        UsageError: there is no folder for it, or nobody knows its format.
    """
    refuse_without_folder("--picture", path)
    if path is not None and path.suffix.lower() not in PICTURES:
        raise UsageError(f"--picture {path}: is no picture: give a name that ends with .png, .svg or .pdf")


PICTURES = ("", ".png", ".svg", ".pdf")
"""How the file of a picture ends; without an end it is written as .png and .svg."""


def numbers_in(what: str, given: str, *, whole: bool = False) -> tuple[float, ...]:
    """Return the numbers in a list with commas.

    Raises:
        UsageError: one of them is no number, or with `whole` no whole one.
    """
    found = []
    for text in given.split(","):
        if whole and not text.strip().isdecimal():
            raise UsageError(f"{what} '{text}' is no whole number")
        try:
            found.append(float(text))
        except ValueError:
            raise UsageError(f"{what} '{text}' is no number") from None
    return tuple(found)
