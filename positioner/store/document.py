"""The stiction table as a JSON document: the format of `table export`, of backups and of messages. Pure.

    {"format": "positioner-stiction-table", "schema": 1, "valve": "FV-101", "cell_width_m": 0.005,
     "generation": 0, "sequence": 12, "cells": [
      {"quantity": "breakaway_current_ma", "index": 14, "direction": "opening", "samples": [8.91, 8.87],
       "count": 2, "sequence": 12, "recorded": "2026-05-09T07:35:25Z"}]}

The centre of a cell is `index * cell_width_m`; `samples` has the newest last; `count` is how many the cell ever saw.
"""

from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from positioner.errors import ConfigurationError, Problem
from positioner.store.document_reader import FORMAT, SCHEMA, TableReader
from positioner.valve.stiction import MOST_CELLS

if TYPE_CHECKING:
    from positioner.store.content import StoredTable
    from positioner.valve.stiction import Cell, CellKey


def dumps(stored: StoredTable) -> str:
    """Return the document as text: a line for the table and one for each cell."""
    plain = as_plain(stored)
    cells = ",\n ".join(json.dumps(cell) for cell in plain.pop("cells"))
    return f'{json.dumps(plain)[:-1]}, "cells": [\n {cells}]}}\n'


def as_plain(stored: StoredTable) -> dict[str, Any]:
    """Return the document as what `json.dumps` takes."""
    return {**head(stored), "cells": [plain_cell(*one) for one in cells_of(stored)]}


def head(stored: StoredTable) -> dict[str, Any]:
    """Return all of the document but its cells."""
    return {
        "format": FORMAT,
        "schema": SCHEMA,
        "valve": stored.valve_id,
        "cell_width_m": stored.table.cell_width_m,
        "generation": stored.generation,
        "sequence": stored.table.sequence,
    }


def cells_of(stored: StoredTable) -> list[tuple[CellKey, Cell, int]]:
    """Return the cells in the order of the document, each with the instant of its newest sample."""
    return [(key, cell, stored.recorded_s[key]) for key, cell in stored.table]


def plain_cell(key: CellKey, cell: Cell, recorded_s: int) -> dict[str, Any]:
    """Return a cell of the document."""
    return {
        "quantity": str(key.quantity),
        "index": key.index,
        "direction": str(key.direction),
        "samples": list(cell.samples),
        "count": cell.count,
        "sequence": cell.sequence,
        "recorded": utc_text(recorded_s),
    }


def utc_text(seconds: int) -> str:
    """Return seconds since 1970 as `2026-05-09T07:35:25Z`."""
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def loads(text: str, source: str) -> StoredTable:
    """Return the table in a document; `source` names it in the messages.

    Raises:
        ConfigurationError: the text is not such a document; its mistakes are in `problems`.
    """
    try:
        plain = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(source, (Problem("file", None, f"is not JSON: {error}"),)) from error
    return from_plain(plain, source)


def from_plain(plain: Any, source: str) -> StoredTable:
    """Return the table in a document that `json.loads` has read.

    Raises:
        ConfigurationError: as `loads`.
    """
    reader = TableReader(source)
    if isinstance(plain, dict) and isinstance(plain.get("cells"), list):
        reader.take(plain["cells"][: MOST_CELLS + 1])
    return reader.finish(plain)
