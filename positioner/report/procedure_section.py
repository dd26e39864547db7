"""What any test procedure has found, as a section: its rows, beside those of the reference, and its remarks. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.report import words
from positioner.report.page import Section
from positioner.report.table import Table

if TYPE_CHECKING:
    from positioner.commissioning.results import KeptResult
    from positioner.report.chart import Chart

    Row = dict[str, Any]

_UNSEEN = "not shown by this experiment"
_INTERVAL, _REFERENCE = "95 % interval", "reference"


def procedure_section(
    title: str,
    result: KeptResult,
    before: KeptResult | None,
    charts: tuple[Chart, ...] = (),
    tables: tuple[Table, ...] = (),
    facts: tuple[tuple[str, str], ...] = (),
) -> Section:
    """Return the section of a result; `before` is the reference of its kind, which may be the result itself."""
    rows: list[Row] = result.document.get("rows", [])
    compared = before if before is not None and before.name != result.name else None
    since = f"measured {words.date(result.recorded)}"
    since += f"; reference {words.date(compared.recorded)}" if compared else "; this is the reference" if before else ""
    earlier = {_key(row): row for row in compared.document.get("rows", [])} if compared else {}
    between = (_INTERVAL,) if any(row.get("low") is not None for row in rows) else ()
    head = ("", "unit", "value", *between, *((_REFERENCE, "change") if compared else ()))
    decimals = _decimals(rows)
    cells = tuple([_cells(row, earlier.get(_key(row)), decimals[row["unit"]], head) for row in rows])
    own = (Table(head, cells),) if cells else ()
    return Section(title, since, charts, (*tables, *own), tuple(result.document.get("remarks", ())), facts=facts)


def missing_section(title: str, command: str, what: str) -> Section:
    """Return the section of a result that is not there, with the command that gives it."""
    return Section(title, missing=f"Not measured yet. Run {command}: it {what}.")


def _key(row: Row) -> tuple[str, str]:
    return str(row["name"]), str(row["unit"])


def _decimals(rows: list[Row]) -> dict[str, int]:
    """Return by unit the decimals that give its largest value four digits, or three below 1."""
    largest: dict[str, float] = {}
    for row in rows:
        largest[row["unit"]] = max(largest.get(row["unit"], 0.0), abs(row["value"] or 0.0))
    return {unit: words.decimals_of(value, 4 if value >= 1.0 else 3) for unit, value in largest.items()}


def _cells(row: Row, before: Row | None, decimals: int, head: tuple[str, ...]) -> tuple[str, ...]:
    is_seen = row.get("seen", True)
    cells: tuple[str, ...] = (
        str(row["name"]),
        str(row["unit"]),
        words.number(row["value"] if is_seen else None, decimals),
    )
    if _INTERVAL in head:
        cells = (*cells, words.interval(row.get("low"), row.get("high"), decimals) if is_seen else _UNSEEN)
    if _REFERENCE not in head:
        return cells
    if before is None or not is_seen:
        return (*cells, words.NONE, words.NONE)
    was = words.number(before["value"], decimals)
    return (*cells, was, words.NONE if was == "0" else words.change(before["value"], row["value"]))
