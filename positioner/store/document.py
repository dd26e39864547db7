"""The stiction table as plain values, checked by pydantic: the JSON document, and what rows and messages hold. Pure.

    {"format": "positioner-stiction-table", "schema": 2, "valve": "FV-101", "cell_width_m": 0.005,
     "generation": 0, "sequence": 12, "fit": null, "cells": [
      {"quantity": "breakaway_current_ma", "index": 14, "direction": "opening", "samples": [8.91, 8.87],
       "count": 2, "sequence": 12, "recorded": "2026-05-09T07:35:25Z"}]}

The centre of a cell is `index * cell_width_m`; `samples` has the newest last; `count` is how many the cell ever took.
`fit` is null or an object with K, F_s, F_c and the lags, their covariance, and when it was kept. Schema 1 has none.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BeforeValidator, Field, TypeAdapter, ValidationError

from positioner.errors import ConfigurationError, Problem
from positioner.inputs.table import SettingsTable
from positioner.store.content import StoredTable
from positioner.valve.fit import ValveFit
from positioner.valve.stiction import (
    FARTHEST_M,
    MOST_CELLS,
    SAMPLES_KEPT,
    Cell,
    CellKey,
    Direction,
    Quantity,
    StictionTable,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from pydantic_core import ErrorDetails

T = TypeVar("T")

FORMAT = "positioner-stiction-table"
_LARGEST = 2**52
"""A valve that learns a thousand samples a second reaches it in 140,000 years; JSON is exact up to it."""
_LATEST_S = 253_402_300_799  # the last second of the year 9999, where ISO dates end
_MOST_PROBLEMS = 20
_LONGEST_SHOWN = 40
_TEXTS = {
    "dataclass_type": "must be an object",
    "missing": "is required and missing",
    "unexpected_keyword_argument": "unknown key",
    "tuple_type": "must be a list",
    "too_long": f"are too many: a table holds at most {MOST_CELLS}",
}


def _seconds(text: object) -> int:
    try:
        when = datetime.fromisoformat(str(text))
    except ValueError:
        when = None
    if when is None or when.tzinfo is None or not 0 <= when.timestamp() <= _LATEST_S:
        raise ValueError("must be a UTC time from 1970 to 9999 like 2026-05-09T07:35:25Z")
    return int(when.timestamp())


def _printable(text: str) -> str:
    if text and text.isprintable():
        return text
    raise ValueError("must be a printable text")


def _consistent(cell: PlainCell) -> PlainCell:
    low, high = cell.quantity.limits
    if wrong := [value for value in cell.samples if not low <= value <= high]:
        raise ValueError(f"samples of {cell.quantity} must be from {low:g} to {high:g}, not {wrong[0]!r}")
    if len(cell.samples) != min(cell.count, SAMPLES_KEPT):
        raise ValueError(f"count must fit the {len(cell.samples)} samples: the last {SAMPLES_KEPT} are kept")
    return cell


_Whole = Annotated[int, Field(strict=True, ge=0, le=_LARGEST)]
_Positive = Annotated[int, Field(strict=True, ge=1, le=_LARGEST)]
_Index = Annotated[int, Field(strict=True, ge=-_LARGEST, le=_LARGEST)]


@dataclass(frozen=True, slots=True)
class PlainCell(SettingsTable):
    """A cell of the document; `recorded` in seconds since 1970."""

    quantity: Quantity
    index: _Index
    direction: Direction
    samples: tuple[Annotated[float, Field(strict=True)], ...]
    count: _Positive
    sequence: _Positive
    recorded: Annotated[int, BeforeValidator(_seconds)]

    @property
    def key(self) -> CellKey:
        """Address of the cell in the table."""
        return CellKey(self.quantity, self.index, self.direction)


@dataclass(frozen=True, slots=True)
class PlainFit(ValveFit):
    """The fit of the document; `recorded` in seconds since 1970."""

    recorded: Annotated[int, BeforeValidator(_seconds)]


_Cells = tuple[Annotated[PlainCell, AfterValidator(_consistent)], ...]


@dataclass(frozen=True, slots=True)
class _Document(SettingsTable):
    format: Literal["positioner-stiction-table"]
    schema: Literal[1, 2]
    valve: Annotated[str, AfterValidator(_printable)]
    cell_width_m: Annotated[float, Field(strict=True, ge=1e-6, le=10.0)]
    generation: _Whole
    sequence: _Whole
    cells: Annotated[_Cells, Field(max_length=MOST_CELLS)]
    fit: PlainFit | None = None


_DOCUMENT = TypeAdapter(_Document)
_CELLS = TypeAdapter(_Cells)


def dumps(stored: StoredTable) -> str:
    """Return the document as text: a line for the table and one for each cell."""
    lines = ",\n ".join(json.dumps(cell) for cell in cells(stored))
    return f'{json.dumps(head(stored))[:-1]}, "cells": [\n {lines}]}}\n'


def head(stored: StoredTable) -> dict[str, Any]:
    """Return all of the document but its cells, as `json.dumps` takes it."""
    fit = stored.table.fit
    return {
        "format": FORMAT,
        "schema": 2,
        "valve": stored.valve_id,
        "cell_width_m": stored.table.cell_width_m,
        "generation": stored.generation,
        "sequence": stored.table.sequence,
        "fit": None if fit is None else {**asdict(fit), "recorded": utc_text(stored.fit_recorded_s)},
    }


def cells(stored: StoredTable) -> Iterator[dict[str, Any]]:
    """Yield the cells of the document, as `json.dumps` takes them, by quantity, position and direction."""
    for key, cell in stored.table:
        yield {
            "quantity": str(key.quantity),
            "index": key.index,
            "direction": str(key.direction),
            "samples": list(cell.samples),
            "count": cell.count,
            "sequence": cell.sequence,
            "recorded": utc_text(stored.recorded_s[key]),
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


def from_plain(plain: Any, source: str, cells_before: Sequence[PlainCell] = ()) -> StoredTable:
    """Return the table in a document that `json.loads` has read; `cells_before` are cells that came before it.

    Raises:
        ConfigurationError: as `loads`.
    """
    if not isinstance(plain, dict) or plain.get("format") != FORMAT:
        raise ConfigurationError(source, (Problem("file", None, f'is not a stiction table: no "format": "{FORMAT}"'),))
    if isinstance(given := plain.get("cells"), list):
        plain = {**plain, "cells": given[: MOST_CELLS + 1]}
    document = _validated(_DOCUMENT, plain, source)
    plain_cells = (*cells_before, *document.cells)
    by_key = {one.key: one for one in plain_cells}
    least = max((sum(one.count for one in plain_cells), *(one.sequence for one in plain_cells)))
    width_m = document.cell_width_m
    problem = None
    if len(plain_cells) > MOST_CELLS:
        problem = Problem("cells", None, _TEXTS["too_long"])
    elif len(by_key) < len(plain_cells):
        problem = Problem("cells", None, "hold a second cell for the same quantity, index and direction")
    elif any(abs(one.index * width_m) > FARTHEST_M + width_m for one in plain_cells):
        problem = Problem("cells", None, f"lie farther away than {FARTHEST_M:g} m")
    elif document.sequence < least:
        problem = Problem("sequence", None, f"must be at least {least}, as the cells say, not {document.sequence}")
    if problem:
        raise ConfigurationError(source, (problem,))
    kept = document.fit
    fit = None if kept is None else ValveFit(*(getattr(kept, each.name) for each in fields(ValveFit)))
    table = {key: Cell(one.samples, one.count, one.sequence) for key, one in by_key.items()}
    return StoredTable(
        document.valve,
        StictionTable(width_m, document.sequence, MappingProxyType(table), fit),
        document.generation,
        MappingProxyType({key: one.recorded for key, one in by_key.items()}),
        0 if kept is None else kept.recorded,
    )


def cells_from(plain: Any, source: str) -> tuple[PlainCell, ...]:
    """Return some cells of a document.

    Raises:
        ConfigurationError: as `loads`.
    """
    return _validated(_CELLS, plain, source)


def _validated(adapter: TypeAdapter[T], plain: Any, source: str) -> T:
    try:
        return adapter.validate_python(plain)
    except ValidationError as error:
        problems = map(_problem, error.errors(include_url=False)[:_MOST_PROBLEMS])
        raise ConfigurationError(source, tuple(problems)) from error


def _problem(item: ErrorDetails) -> Problem:
    """Return one mistake as one line: where it is, what it must be, and the beginning of what it is."""
    where = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in item["loc"]).lstrip(".")
    text = _TEXTS.get(item["type"])
    if text is None:
        text = item["msg"].removeprefix("Value error, ").replace("Input should be", "must be")
        if not isinstance(value := item["input"], dict):
            is_short = type(value) is not int or abs(value) <= _LARGEST
            shown = repr(value) if is_short else "such a large number"
            text += f", not {shown if len(shown) <= _LONGEST_SHOWN else f'{shown[:_LONGEST_SHOWN]}…'}"
    return Problem(where or "file", None, text)
