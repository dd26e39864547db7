"""The failure-modes table of SAFETY.md, read for the tests that compare it with the code."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "SAFETY.md"
COLUMNS = ("", "cause", "detection", "reaction", "within", "test")
_TEST = re.compile(r"`(\w+/test_\w+\.py::\w+(?:::\w+)?)`")


@dataclass(frozen=True, slots=True)
class Row:
    """One failure mode: its name in the first column, and the tests in the last one, as pytest node ids."""

    name: str
    cause: str
    detection: str
    reaction: str
    within: str
    tests: tuple[str, ...]


def read_rows(text: str) -> tuple[Row, ...]:
    """Return the rows of every table that has the columns of a failure-modes table."""
    rows: list[Row] = []
    inside = False
    for number, line in enumerate(text.splitlines(), start=1):
        cells = tuple(cell.strip() for cell in line.strip().strip("|").split("|")) if line.startswith("|") else ()
        if cells == COLUMNS:
            inside = True
        elif not cells:
            inside = False
        elif inside and set(line) - set("|-: "):
            rows.append(_row(cells, number))
    return tuple(rows)


def _row(cells: tuple[str, ...], number: int) -> Row:
    if len(cells) != len(COLUMNS) or not all(cells):
        raise ValueError(f"SAFETY.md, line {number}: {len(COLUMNS)} columns are wanted, each with something in it")
    tests = tuple(f"tests/{name}" for name in _TEST.findall(cells[-1]))
    if not tests:
        raise ValueError(f"SAFETY.md, line {number}: the last column names no `folder/test_file.py::test_name`")
    name, cause, detection, reaction, within, _ = cells
    return Row(name, cause, detection, reaction, within, tests)
