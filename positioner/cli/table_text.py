"""The stiction table as text for people, and as rows for spreadsheets. Pure."""

from __future__ import annotations

import math
from itertools import groupby
from typing import TYPE_CHECKING

from positioner.inputs.durations import duration
from positioner.report.table import Table
from positioner.store.document import utc_text
from positioner.valve.stiction import Cell, CellKey, Direction, Quantity

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.report.text import Block
    from positioner.store.content import StoredTable

_MM = 1e3
_COLUMNS = (
    (Quantity.STICK_SPEED, "stick speed, mm/s", _MM, 1),
    (Quantity.BREAKAWAY_CURRENT, "breakaway Γ, mA", 1.0, 3),
    (Quantity.LANDING_BIAS, "landing bias, mm", _MM, 3),
)
_LEGEND = "Mean ± spread of the last ten samples; n: all samples; age: samples learned elsewhere since the newest."


def summary(stored: StoredTable) -> str:
    """Return whose table it is and how much is in it, in one line."""
    table = stored.table
    samples = sum(cell.count for _, cell in table)
    return f"valve {stored.valve_id}: {samples} samples in {len(table)} cells of {table.cell_width_m * _MM:g} mm"


def blocks(stored: StoredTable) -> list[Block]:
    """Return the table with a row for each position and direction, and what it means."""
    if not len(stored.table):
        return [f"{summary(stored)}: the table is empty"]
    heads = [head for _, title, _, _ in _COLUMNS for head in (title, "n")]
    table = Table.of(("position, mm", "direction", *heads, "age", "newest"), _rows(stored), names=2)
    return [summary(stored), *_fit(stored), "", table, "", _LEGEND]


def _fit(stored: StoredTable) -> Iterator[str]:
    """Yield K, F_s, F_c and the lags with their standard deviations, in one line, where the law has kept them."""
    fit = stored.table.fit
    if fit is None:
        return
    lag = math.sqrt(fit.tt)
    parts = (
        f"K {fit.spring_n_per_m:.0f} ± {math.sqrt(fit.kk):.0f} N/m",
        f"F_s {fit.static_n:.0f} ± {math.sqrt(fit.ff):.0f} N",
        f"F_c {fit.sliding_n:.0f} ± {math.sqrt(fit.sliding_n2):.0f} N",
        f"fill {duration(fit.fill_s, 3)}, vent {duration(fit.vent_s, 3)} ± {100.0 * lag:.1f} %",
    )
    yield f"learned from all slips: {', '.join(parts)}; {utc_text(stored.fit_recorded_s)}"


def csv_rows(stored: StoredTable) -> Iterator[tuple[str, ...]]:
    """Yield a row of titles and one for each cell, in the unit that the quantity's name ends with."""
    yield "quantity", "position_m", "direction", "mean", "spread", "count", "age", "recorded", "samples"
    for key, cell in stored.table:
        position = f"{key.index * stored.table.cell_width_m:.6g}"
        numbers = (repr(cell.mean), repr(cell.spread), str(cell.count), str(stored.table.age(cell)))
        samples = " ".join(map(repr, cell.samples))
        yield str(key.quantity), position, str(key.direction), *numbers, utc_text(stored.recorded_s[key]), samples


def _rows(stored: StoredTable) -> Iterator[tuple[str, ...]]:
    def place(item: tuple[CellKey, Cell]) -> tuple[int, Direction]:
        return item[0].index, item[0].direction

    for (index, direction), group in groupby(sorted(stored.table, key=place), key=place):
        cells = {key.quantity: cell for key, cell in group}
        newest = max(cells.values(), key=lambda cell: cell.sequence)
        recorded = max(stored.recorded_s[CellKey(quantity, index, direction)] for quantity in cells)
        position_mm = index * stored.table.cell_width_m * _MM
        parts = [_part(cells.get(quantity), scale, digits) for quantity, _, scale, digits in _COLUMNS]
        learned = [cell for part in parts for cell in part]
        yield f"{position_mm:.1f}", str(direction), *learned, str(stored.table.age(newest)), utc_text(recorded)


def _part(cell: Cell | None, scale: float, digits: int) -> tuple[str, str]:
    if cell is None:
        return "–", "–"
    return f"{cell.mean * scale:.{digits}f} ± {cell.spread * scale:.{digits}f}", str(cell.count)
