"""The stiction table as a view shows it: how many samples each cell has, by quantity, direction and place. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from positioner.valve.stiction import Direction, Quantity

if TYPE_CHECKING:
    from positioner.store.content import StoredTable

_NAMES = {
    Quantity.BREAKAWAY_CURRENT: "breakaway",
    Quantity.STICK_SPEED: "stick speed",
    Quantity.LANDING_BIAS: "landing bias",
}


@dataclass(frozen=True, slots=True)
class TableRow:
    """The cells of one quantity in one direction: the samples ever taken, by the index of the cell."""

    name: str
    counts: dict[int, int]


@dataclass(frozen=True, slots=True)
class TableView:
    """How much is in a table; the centre of a cell is its index times `cell_width_m`."""

    samples: int
    cells: int
    cell_width_m: float
    rows: tuple[TableRow, ...]


def table_view(stored: StoredTable) -> TableView:
    """Return how much is in a table."""
    counts: dict[tuple[Quantity, Direction], dict[int, int]] = {}
    for key, cell in stored.table:
        counts.setdefault((key.quantity, key.direction), {})[key.index] = cell.count
    rows = tuple(
        TableRow(f"{name}, {direction}", counts[quantity, direction])
        for quantity, name in _NAMES.items()
        for direction in Direction
        if (quantity, direction) in counts
    )
    samples = sum(sum(each.counts.values()) for each in rows)
    return TableView(samples, len(stored.table), stored.table.cell_width_m, rows)
