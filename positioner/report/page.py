"""A report as data, and as one HTML page: verdict first, then sections of tables, figures and remarks. Shell.

The page needs no network and no script. What it shows is in `page.html.j2`, how it looks in `page.css`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import TYPE_CHECKING

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from positioner.pictures.colours import BELIEF, CLOSING, INK, OPENING, REFERENCE, STATUS

if TYPE_CHECKING:
    from jinja2 import Template

    from positioner.report.chart import Chart
    from positioner.report.picture import Picture
    from positioner.report.table import Table


_SIDES = {"opening": OPENING, "closing": CLOSING}


class Status(Enum):
    """A NAMUR NE 107 status signal: its name, and its letter in the symbol."""

    UNKNOWN = ("Not judged yet", "–")
    GOOD = ("Good", "")
    MAINTENANCE_REQUIRED = ("Maintenance required", "M")
    OUT_OF_SPECIFICATION = ("Out of specification", "S")
    FUNCTION_CHECK = ("Function check", "C")
    FAILURE = ("Failure", "F")

    @property
    def words(self) -> str:
        """The name that a person reads."""
        return self.value[0]

    @property
    def letter(self) -> str:
        """The letter in the symbol."""
        return self.value[1]

    @property
    def style(self) -> str:
        """The class of the style sheet."""
        return self.name.lower().replace("_", "-")


@dataclass(frozen=True, slots=True)
class Verdict:
    """The first thing that is read: the status, one sentence that gives the reason, and what to do, if anything."""

    status: Status
    sentence: str
    action: str
    heading: str = ""

    @property
    def words(self) -> str:
        """The heading, or else the name of the status."""
        return self.heading or self.status.words


@dataclass(frozen=True, slots=True)
class Section:
    """One part of the page; `since` says when it was measured, `missing` what to run where there is nothing to show.

    The charts stand in rows, pictures below each other; `facts` are names and values in several columns.
    """

    title: str
    since: str = ""
    charts: tuple[Chart, ...] = ()
    tables: tuple[Table, ...] = ()
    remarks: tuple[str, ...] = ()
    missing: str = ""
    facts: tuple[tuple[str, str], ...] = ()
    pictures: tuple[Picture, ...] = ()


@dataclass(frozen=True, slots=True)
class Page:
    """The whole report: `title` is what it is about, `subtitle` what it is and when it was made.

    is_wide: with pictures that need the width of a screen.
    """

    title: str
    subtitle: str
    sections: tuple[Section, ...]
    verdict: Verdict | None = None
    facts: tuple[tuple[str, str], ...] = ()
    is_wide: bool = False


def html(page: Page) -> str:
    """Return the page as one HTML document."""
    return _template().render(page=page)


@cache
def _template() -> Template:
    files = PackageLoader("positioner.report", ".")
    environment = Environment(
        loader=files,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["colours"] = {"ink": INK, "reference": REFERENCE, "belief": BELIEF, **_SIDES, **STATUS}
    environment.globals["style"] = Markup(files.get_source(environment, "page.css")[0])  # noqa: S704 - our own file
    return environment.get_template("page.html.j2")
