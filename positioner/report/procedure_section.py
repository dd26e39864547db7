"""What any test procedure has found, as a section: its rows, beside those of the reference, and its remarks. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.report import words
from positioner.report.page import Section, Table

if TYPE_CHECKING:
    from positioner.commissioning.results import KeptResult
    from positioner.report.chart import Chart

_UNSEEN = "not shown by this experiment"


def procedure_section(
    title: str, result: KeptResult, before: KeptResult | None, charts: tuple[Chart, ...] = ()
) -> Section:
    """Return the section of a result; `before` is the reference of its kind, which may be the result itself."""
    rows = tuple(result.document.get("rows", ()))
    compared = before if before is not None and before.name != result.name else None
    since = f"measured {words.date(result.recorded)}"
    since += f"; reference {words.date(compared.recorded)}" if compared else "; this is the reference" if before else ""
    earlier = {_key(row): row for row in compared.document.get("rows", ())} if compared else {}
    head = ("", "unit", "value", "95 % interval") + (("reference", "change") if compared else ())
    decimals = _decimals(rows)
    cells = tuple(
        _cells(row, earlier.get(_key(row)), decimals[row["unit"]], is_compared=bool(compared)) for row in rows
    )
    table = (Table(head, cells),) if cells else ()
    return Section(title, since, charts, table, tuple(result.document.get("remarks", ())))


def missing_section(title: str, command: str, what: str) -> Section:
    """Return the section of a result that is not there, with the command that gives it."""
    return Section(title, missing=f"Not measured yet. Run {command}: it {what}.")


def _key(row: dict[str, Any]) -> tuple[str, str]:
    return str(row["name"]), str(row["unit"])


def _decimals(rows: tuple[dict[str, Any], ...]) -> dict[str, int]:
    """Return by unit the decimals that give its largest value four digits: a smaller one is not known better."""
    largest: dict[str, float] = {}
    for row in rows:
        largest[row["unit"]] = max(largest.get(row["unit"], 0.0), abs(row["value"] or 0.0))
    return {unit: words.decimals_of(value) for unit, value in largest.items()}


def _cells(row: dict[str, Any], before: dict[str, Any] | None, decimals: int, *, is_compared: bool) -> tuple[str, ...]:
    shown = row.get("seen", True)
    between = words.interval(row.get("low"), row.get("high"), decimals) if shown else _UNSEEN
    cells = (str(row["name"]), str(row["unit"]), words.number(row["value"], decimals), between)
    if not is_compared:
        return cells
    if before is None:
        return (*cells, words.NONE, words.NONE)
    was = words.number(before["value"], decimals)
    return (*cells, was, words.NONE if was == "0" else words.change(before["value"], row["value"]))
