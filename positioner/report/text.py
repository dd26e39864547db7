"""A report as text: lines and tables, in Markdown, or plain with aligned columns. Pure.

A line may have the marks of Markdown (`code`, **strong**, a heading); plain text leaves them out.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, TypeAlias

from positioner.report.table import Table

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

Block: TypeAlias = str | Table
"""One line, or one table."""

MARKS = re.compile(r"\*\*(?P<strong>.+?)\*\*|`(?P<code>.+?)`")
_HEADING = re.compile(r"^#+ ")
_NUMBER = re.compile(r"[-+−±<>=≤≥ ]*\d(?:[^A-Za-zα-ωΑ-Ωµ]| to )*")
_NO_NUMBER = frozenset({"", "-", "–", "never", "not played", "not measured"})
_GAP = "  "


def markdown(blocks: Iterable[Block]) -> str:
    """Return the text in Markdown."""
    lines = (line for block in blocks for line in (markdown_table(block) if isinstance(block, Table) else (block,)))
    return "".join(f"{line}\n" for line in lines)


def markdown_table(table: Table) -> list[str]:
    """Return the lines of a table."""
    caption = [f"**{table.caption}**", ""] if table.caption else []
    return [
        *caption,
        _markdown_row(table.head),
        _markdown_row("---" for _ in table.head),
        *map(_markdown_row, table.rows),
    ]


def plain(blocks: Iterable[Block]) -> str:
    """Return the text without marks, each column of a table as wide as its widest cell."""
    lines = (
        line for block in blocks for line in (_plain_table(block) if isinstance(block, Table) else (unmarked(block),))
    )
    return "".join(f"{line}\n" for line in lines)


def unmarked(text: str) -> str:
    """Return a line or a cell without the marks of Markdown."""
    return MARKS.sub(lambda found: found["strong"] or found["code"], _HEADING.sub("", text, count=1))


def head_lines(head: str) -> tuple[str, str]:
    """Return a head as two lines: the name, and below it the unit, which follows the first comma."""
    name, _, unit = unmarked(head).partition(", ")
    return name, unit


def is_numeric(cells: Sequence[str]) -> bool:
    """Return whether the cells of a column are numbers, perhaps with intervals, so that they stand at the right."""
    found = [unmarked(cell) for cell in cells]
    return all(cell in _NO_NUMBER or _NUMBER.fullmatch(cell) for cell in found) and any(map(_NUMBER.fullmatch, found))


def _markdown_row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def _plain_table(table: Table) -> Iterator[str]:
    if table.caption:
        yield unmarked(table.caption)
    rows = [tuple(map(unmarked, row)) for row in table.rows]
    right = [is_numeric([row[number] for row in rows]) for number in range(len(table.head))]
    names, units = zip(*map(head_lines, table.head), strict=True)
    widths = [max(map(len, column)) for column in zip(names, units, *rows, strict=True)]
    if any(units):
        yield _aligned([name if unit else "" for name, unit in zip(names, units, strict=True)], widths, right)
    if any(names):
        yield _aligned([unit or name for name, unit in zip(names, units, strict=True)], widths, right)
        yield "─" * (sum(widths) + len(_GAP) * (len(widths) - 1))
    for row in rows:
        yield _aligned(row, widths, right)


def _aligned(cells: Sequence[str], widths: Sequence[int], right: Sequence[bool]) -> str:
    found = zip(cells, widths, right, strict=True)
    return _GAP.join(cell.rjust(width) if is_right else cell.ljust(width) for cell, width, is_right in found).rstrip()
