"""Measured quantities as a table: value, what it lies between, and the change since a reference. Pure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from positioner.report import words
from positioner.report.table import Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    Row = dict[str, Any]

UNSEEN = words.NOT_MEASURED
INTERVAL = "95 % interval"
_PARTS = ("value", "low", "high")
_SINCE = ("reference", "change")


def quantity_table(rows: Sequence[Row], reference: Sequence[Row] | None = None, between: str = INTERVAL) -> Table:
    """Return a line for each row of `commissioning/report.Row.as_json`.

    reference: the rows of an earlier result, None where there is none. between: what `low` and `high` are.
    """
    earlier = {_key(row): row for row in reference or ()}
    is_open = any(not row.get("seen", True) or row.get("low") != row.get("high") for row in rows)
    head = ("quantity", "unit", "value", *((between,) if is_open else ()), *(() if reference is None else _SINCE))
    decimals = _decimals(rows)
    lines = []
    for row in rows:
        digits, is_seen = decimals[row["unit"]], row.get("seen", True)
        name = f"{row['name']} ({row['note']})" if row.get("note") else str(row["name"])
        cells = [name, str(row["unit"]), words.number(row["value"] if is_seen else None, digits)]
        if is_open:
            cells.append(words.interval(row.get("low"), row.get("high"), digits) if is_seen else UNSEEN)
        if reference is not None:
            cells += _compared(row, earlier.get(_key(row)), digits)
        lines.append(cells)
    return Table.of(head, lines)


def _key(row: Row) -> tuple[str, str]:
    return str(row["name"]), str(row["unit"])


def _decimals(rows: Sequence[Row]) -> dict[str, int]:
    """Return by unit the decimals that give its largest value four digits, or three below 1."""
    largest: dict[str, float] = {}
    for row in rows:
        largest[row["unit"]] = max(largest.get(row["unit"], 0.0), _size(row))
    return {unit: words.decimals_of(value, 4 if value >= 1.0 else 3) for unit, value in largest.items()}


def _size(row: Row) -> float:
    """Return how large the value is, or where it is 0 or unknown the ends of its interval; 0 where nothing is known."""
    value, *ends = (abs(each) if each and math.isfinite(each) else 0.0 for each in map(row.get, _PARTS))
    return value or max(ends)


def _compared(row: Row, before: Row | None, digits: int) -> tuple[str, str]:
    """Return the value of the reference, and the change since."""
    if before is None or not row.get("seen", True):
        return words.NONE, words.NONE
    was = words.number(before["value"], digits)
    return was, words.NONE if was == "0" else words.change(before["value"], row["value"])
