"""Reads a stiction table's document, in as many parts as it comes, and tells every mistake in it. Pure."""

from __future__ import annotations

import math
from datetime import datetime
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from positioner.errors import ConfigurationError, Problem
from positioner.store.content import StoredTable
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
    from collections.abc import Iterable

FORMAT = "positioner-stiction-table"
SCHEMA = 1
_LARGEST_WHOLE = 2**52
"""A valve that learns a thousand times a second from now on gets there in 140,000 years; all of it is exact in JSON."""
_WIDTHS_M = (1e-6, 10.0)
_LONGEST_SHOWN = 40
_MOST_PROBLEMS = 20
"""Mistakes that are told of one document."""
_LATEST_S = 253_402_300_799  # the last second of the year 9999, where ISO dates end


class TableReader:
    """Reads a document in as many parts as it comes, and collects the mistakes in it."""

    def __init__(self, source: str) -> None:
        """Begin an empty table; `source` names the document in the messages."""
        self.problems: list[Problem] = []
        self._source = source
        self._cells: dict[CellKey, Cell] = {}
        self._recorded_s: dict[CellKey, int] = {}
        self._taken = 0

    def take(self, items: Iterable[Any]) -> None:
        """Take the next cells."""
        for item in items:
            if self._taken > MOST_CELLS or len(self.problems) >= _MOST_PROBLEMS:
                return
            self._take(item, f"cells[{self._taken}]")
            self._taken += 1

    def finish(self, plain: Any) -> StoredTable:
        """Return the table of the cells that were taken, with all else that `plain` says of it.

        Raises:
            ConfigurationError: as `loads`.
        """
        in_cells, self.problems = self.problems, []
        stored = self._stored(plain)
        problems = [*self.problems, *in_cells][:_MOST_PROBLEMS]
        if problems or stored is None:
            raise ConfigurationError(self._source, tuple(problems))
        return stored

    def _stored(self, plain: Any) -> StoredTable | None:
        if not isinstance(plain, dict) or plain.get("format") != FORMAT:
            self._wrong("file", f'is not a stiction table: "format" must be "{FORMAT}"')
            return None
        if plain.get("schema") != SCHEMA:
            self._wrong("schema", f"must be {SCHEMA}, not {_short(plain.get('schema'))}")
            return None
        self._only(plain, "", ("format", "schema", "valve", "cell_width_m", "generation", "sequence", "cells"))
        valve_id = self._text(plain, "", "valve")
        width_m = self._number(plain.get("cell_width_m"), "cell_width_m", _WIDTHS_M)
        generation = self._whole(plain, "", "generation", 0)
        sequence = self._whole(plain, "", "sequence", 0)
        if not isinstance(plain.get("cells"), list):
            self._wrong("cells", "must be a list")
        if self._taken > MOST_CELLS:
            self._wrong("cells", f"are too many: a table holds at most {MOST_CELLS}")
        if width_m is not None and any(abs(key.index * width_m) > FARTHEST_M + width_m for key in self._cells):
            self._wrong("cells", f"lie farther away than {FARTHEST_M:g} m")
        cells = self._cells
        newest = max((cell.sequence for cell in cells.values()), default=0)
        least = max(newest, sum(cell.count for cell in cells.values()))
        if sequence is not None and sequence < least:
            self._wrong("sequence", f"must be at least {least}, as the cells say, not {sequence}")
        if valve_id is None or width_m is None or generation is None or sequence is None:
            return None
        table = StictionTable(width_m, sequence, MappingProxyType(cells))
        return StoredTable(valve_id, table, generation, MappingProxyType(self._recorded_s))

    def _take(self, item: Any, where: str) -> None:
        if not isinstance(item, dict):
            self._wrong(where, "must be an object")
            return
        key, seconds = self._key(item, where), self._recorded(item, where)
        cell = self._cell(item, where, key.quantity if key else None)
        if key in self._cells:
            self._wrong(where, f"is a second cell for {key.quantity}, index {key.index}, {key.direction}")
        if key and cell and seconds is not None:
            self._cells[key], self._recorded_s[key] = cell, seconds

    def _key(self, item: dict[str, Any], where: str) -> CellKey | None:
        self._only(item, where, ("quantity", "index", "direction", "samples", "count", "sequence", "recorded"))
        quantity = self._one_of(item, where, "quantity", tuple(str(one) for one in Quantity))
        index = self._whole(item, where, "index", -_LARGEST_WHOLE)
        direction = self._one_of(item, where, "direction", tuple(str(one) for one in Direction))
        if quantity is None or index is None or direction is None:
            return None
        return CellKey(Quantity(quantity), index, Direction(direction))

    def _cell(self, item: dict[str, Any], where: str, quantity: Quantity | None) -> Cell | None:
        count = self._whole(item, where, "count", 1)
        sequence = self._whole(item, where, "sequence", 1)
        values = item.get("samples")
        if not isinstance(values, list) or not 1 <= len(values) <= SAMPLES_KEPT:
            self._wrong(f"{where}.samples", f"must be a list of 1 to {SAMPLES_KEPT} numbers")
            return None
        limits = quantity.limits if quantity else (-math.inf, math.inf)
        samples = [self._number(value, f"{where}.samples[{number}]", limits) for number, value in enumerate(values)]
        if count is not None and len(samples) != min(count, SAMPLES_KEPT):
            self._wrong(f"{where}.count", f"must fit the {len(samples)} samples: the last {SAMPLES_KEPT} are kept")
        if count is None or sequence is None:
            return None
        return Cell(tuple(value for value in samples if value is not None), count, sequence)

    def _recorded(self, item: dict[str, Any], where: str) -> int | None:
        text = item.get("recorded")
        try:
            when = datetime.fromisoformat(str(text))
        except ValueError:
            when = None
        if when is None or when.tzinfo is None:
            self._wrong(f"{where}.recorded", f"must be a UTC time like 2026-05-09T07:35:25Z, not {_short(text)}")
            return None
        seconds = int(when.timestamp())
        if not 0 <= seconds <= _LATEST_S:
            self._wrong(f"{where}.recorded", f"must be between 1970 and 9999, not {_short(text)}")
            return None
        return seconds

    def _wrong(self, where: str, message: str) -> None:
        self.problems.append(Problem(where, None, message))

    def _only(self, item: dict[str, Any], where: str, known: Iterable[str]) -> None:
        for name in item.keys() - set(known):
            self._wrong(_join(where, name), f"unknown key; known here: {', '.join(known)}")

    def _text(self, item: dict[str, Any], where: str, name: str) -> str | None:
        value = item.get(name)
        if isinstance(value, str) and value and value.isprintable():
            return value
        self._wrong(_join(where, name), f"must be a printable text, not {_short(value)}")
        return None

    def _one_of(self, item: dict[str, Any], where: str, name: str, choices: tuple[str, ...]) -> str | None:
        value = item.get(name)
        if value in choices:
            return str(value)
        self._wrong(_join(where, name), f"must be one of {', '.join(choices)}, not {_short(value)}")
        return None

    def _whole(self, item: dict[str, Any], where: str, name: str, lowest: int) -> int | None:
        value = item.get(name)
        if type(value) is int and lowest <= value <= _LARGEST_WHOLE:
            return value
        told = f"must be a whole number from {lowest} to {_LARGEST_WHOLE}, not {_short(value)}"
        self._wrong(_join(where, name), told)
        return None

    def _number(self, value: Any, where: str, limits: tuple[float, float]) -> float | None:
        low, high = limits
        if type(value) in {int, float} and low <= value <= high:
            return float(value)
        self._wrong(where, f"must be a number from {low:g} to {high:g}, not {_short(value)}")
        return None


def _join(where: str, name: str) -> str:
    return f"{where}.{name}" if where else name


def _short(value: Any) -> str:
    """Return the value as a message shows it: its beginning."""
    if type(value) is int and abs(value) > _LARGEST_WHOLE:
        return "such a large number"
    text = repr(value)
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}…"
