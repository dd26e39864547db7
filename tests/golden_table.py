"""Tables as released versions wrote them, one for each schema: `tests/tables/v<schema>.sqlite`, and the same as JSON.

PYTHONPATH=tests python -m golden_table     writes the table of the present schema, before it is released
"""

from __future__ import annotations

import sys
from pathlib import Path

from store_helpers import NOW_S, WIDTH_M

from positioner.store import database, document, schema
from positioner.store.content import StoredTable
from positioner.valve.fit import ValveFit
from positioner.valve.stiction import Direction, LearnedSample, Quantity, StictionTable

FOLDER = Path(__file__).resolve().parent / "tables"
FIT = ValveFit(52431.7, 1693.2, 0.051, 0.032, 9e4, -2e3, -1.5, 400.0, 0.03, 1e-4, 0.04, 1417.9, 160.0)
PRESENT = len(schema.MIGRATIONS)


def sqlite_file(version: int) -> Path:
    """Return the path of the golden table of a schema."""
    return FOLDER / f"v{version}.sqlite"


def content(version: int) -> StoredTable:
    """Return the content of the golden table of a schema."""
    path = FOLDER / f"v{version}.json"
    return document.loads(path.read_text(encoding="utf-8"), str(path))


def example() -> StoredTable:
    """Return a table with all that there is: quantities, both directions, full cells, a place below zero, a fit."""
    stored = StoredTable("FV-101 «Süd»", StictionTable(cell_width_m=WIDTH_M), generation=3)
    for number in range(260):
        quantity, direction = tuple(Quantity)[number % 3], tuple(Direction)[number // 3 % 2]
        place_m = -0.0061 + 0.0041 * (number // 6 % 4)
        value = quantity.limits[1] * (0.001 + number / 700.0)
        fit = FIT if number % 7 == 0 else None
        stored = stored.learned(LearnedSample(quantity, place_m, direction, value, fit), NOW_S + 60 * number)
    return stored


if __name__ == "__main__":
    path = sqlite_file(PRESENT)
    if path.exists():
        sys.exit(f"{path} is there already: a released table never changes; a new schema is a new migration")
    database.create(path, example())
    path.with_suffix(".json").write_text(document.dumps(example()), encoding="utf-8")
