"""`--report` of a command that plays something: the page, and the command that plays it again. Shell."""

from __future__ import annotations

import shlex
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from positioner.cli.command import refuse_without_folder
from positioner.cli.tables import note
from positioner.errors import writing

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterable

    from positioner.report.page import Page, Verdict
    from positioner.report.picture import Picture
    from positioner.report.text import Block


def add_report(parser: argparse.ArgumentParser) -> None:
    """Add `--report`."""
    parser.add_argument(
        "--report", type=Path, metavar="FILE", help="write one HTML page: verdict, figures, pictures, settings"
    )


def check_report(arguments: argparse.Namespace) -> None:
    """Refuse a page for which there is no folder, before anything is played.

    Raises:
        UsageError: there is none.
    """
    refuse_without_folder("--report", arguments.report)


def command_again(arguments: argparse.Namespace, command: str, options: Iterable[str], **fixed: object) -> str:
    """Return the command line that plays the same again.

    Args:
        arguments: of this command line.
        command: its name.
        options: names of the options that change what is played.
        fixed: options with a value that the command line may have left to a default.
    """
    words = ["positioner", command]
    for name in options:
        value = fixed.get(name, getattr(arguments, name))
        if value is None or value is False:
            continue
        words.append(f"--{name.replace('_', '-')}")
        if value is not True:
            words.append(str(value))
    return shlex.join(words)


def picture_in(path: Path, title: str) -> Picture:
    """Return the picture in an SVG file."""
    from positioner.report.picture import Picture  # noqa: PLC0415 - what makes pages is needed with --report only

    return Picture(title, path.read_text(encoding="utf-8"))


def write_study(
    arguments: argparse.Namespace, name: str, found: Iterable[Block], settings: dict[str, object], verdict: Verdict
) -> None:
    """Write the page of a league whose files have this name.

    Raises:
        StateError: it cannot be written.
    """
    from positioner.bench.result import installed_versions  # noqa: PLC0415 - most commands are no studies
    from positioner.report import words  # noqa: PLC0415
    from positioner.studies.report_page import study_page  # noqa: PLC0415

    picture = picture_in(arguments.out / f"{name}.svg", "Laws compared")
    again = command_again(arguments, "league", _LEAGUE)
    title = "League" if name == "league" else "League on real valves"
    about = {"written": words.date(datetime.now(UTC)), **installed_versions()}
    page = study_page(title, verdict, found, picture, settings, again, about)
    write_page(arguments.report, page)


_LEAGUE = (
    *("real_valves", "short", "laws", "plants", "rival_plants", "seeds", "setpoints", "restart", "dwell", "period"),
    *("tau", "noise", "exact", "conditions"),
)
"""Options of a league on which the figures depend."""


def write_page(path: Path, page: Page) -> None:
    """Write the page, and tell where it is.

    Raises:
        StateError: it cannot be written.
    """
    from positioner.report.page import html  # noqa: PLC0415 - the template engine

    with writing(path):
        path.write_text(html(page), encoding="utf-8")
    note(f"report: {path}")
