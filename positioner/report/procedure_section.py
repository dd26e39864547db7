"""What any test procedure has found, as a section: its rows, beside those of the reference, and its remarks. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.report import words
from positioner.report.page import Section
from positioner.report.quantities import INTERVAL, quantity_table

if TYPE_CHECKING:
    from positioner.commissioning.results import KeptResult
    from positioner.report.chart import Chart
    from positioner.report.table import Table


def procedure_section(
    title: str,
    result: KeptResult,
    before: KeptResult | None,
    charts: tuple[Chart, ...] = (),
    tables: tuple[Table, ...] = (),
    facts: tuple[tuple[str, str], ...] = (),
) -> Section:
    """Return the section of a result; `before` is the reference of its kind, which may be the result itself."""
    rows = result.document.get("rows", [])
    compared = before if before is not None and before.name != result.name else None
    since = f"measured {words.date(result.recorded)}"
    since += f"; reference {words.date(compared.recorded)}" if compared else "; this is the reference" if before else ""
    earlier = compared.document.get("rows", []) if compared else None
    own = (quantity_table(rows, earlier, str(result.document.get("between", INTERVAL))),) if rows else ()
    return Section(title, since, charts, (*tables, *own), tuple(result.document.get("remarks", ())), facts=facts)


def missing_section(title: str, command: str, what: str) -> Section:
    """Return the section of a result that is not there, with the command that gives it."""
    return Section(title, missing=f"Not measured yet. Run {command}: it {what}.")
