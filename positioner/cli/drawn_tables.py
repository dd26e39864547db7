"""Lines and tables in a terminal, as wide as it is: no figure is cut. Shell.

A table that is too wide first wraps its heads and its words, never a number. If that is not enough, it is split: each
part begins with the columns that name the rows.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self, TextIO

from rich import table as rich_table
from rich.box import Box
from rich.cells import cell_len
from rich.console import Console
from rich.text import Text

from positioner.machine.plain_text import showable
from positioner.report.text import MARKS, head_lines, is_numeric, unmarked

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from positioner.report.table import Table
    from positioner.report.text import Block

_GAP = 2
_SHORTEST_TEXT = 14
"""Columns of words are not made narrower than this, if they need it."""
_STYLES = {"strong": "bold", "code": "cyan"}


@dataclass(frozen=True, slots=True)
class _Column:
    """One column: its cells with marks, and how wide it wants to be and must be."""

    head: tuple[str, str]
    cells: tuple[str, ...]
    numeric: bool
    natural: int
    least: int

    @classmethod
    def of(cls, head: str, cells: tuple[str, ...], widest: int) -> Self:
        """Return the column; no word can be wider than the terminal."""
        shown, heads = [unmarked(cell) for cell in cells], head_lines(head)
        cell_width = max(map(cell_len, shown), default=0)
        natural = max(cell_width, *map(cell_len, heads))
        numeric = is_numeric(cells)
        words = _longest_word(heads if numeric else [*heads, *shown])
        least = max(cell_width, words) if numeric else max(words, min(natural, _SHORTEST_TEXT))
        return cls(heads, cells, numeric, max(1, min(natural, widest)), max(1, min(least, widest)))


def draw(blocks: Iterable[Block], stream: TextIO) -> None:
    """Write the blocks to a terminal."""
    size = shutil.get_terminal_size()
    console = Console(file=stream, width=size.columns, height=size.lines, highlight=False, emoji=False, markup=False)
    for block in blocks:
        if isinstance(block, str):
            line = _text(block)
            console.print(line, soft_wrap=_is_command(block))
        else:
            _draw_table(console, block, showable("─", stream))


def _draw_table(console: Console, table: Table, rule: str) -> None:
    if table.caption:
        console.print(Text(unmarked(table.caption), style="bold"))
    columns = [
        _Column.of(head, tuple(row[number] for row in table.rows), console.width)
        for number, head in enumerate(table.head)
    ]
    for number, part in enumerate(_parts(columns, table.names, console.width)):
        if number:
            console.print()
        widths = _widths(part, console.width)
        drawn = rich_table.Table(
            box=_box(rule), show_edge=False, pad_edge=False, padding=(0, _GAP - 1, 0, 0), show_header=any(table.head)
        )
        for column, width in zip(part, widths, strict=True):
            head = Text("\n".join(filter(None, column.head)), style="bold")
            justify = "right" if column.numeric else "left"
            drawn.add_column(head, width=width, justify=justify, vertical="top", overflow="fold")  # type: ignore[arg-type]
        for index, row in enumerate(zip(*(column.cells for column in part), strict=True)):
            drawn.add_row(*map(_text, row), style="bold" if index in table.marked else None)
        console.print(drawn)


def _parts(columns: Sequence[_Column], names: int, room: int) -> list[list[_Column]]:
    """Return the columns in groups that fit, if any does; each begins with the columns that name the rows."""
    first, others = list(columns[:names]), columns[names:]
    groups = [[*first]]
    for column in others:
        group = groups[-1]
        if len(group) > names and sum(each.least + _GAP for each in group) + column.least > room:
            group = [*first]
            groups.append(group)
        group.append(column)
    return groups


def _widths(columns: Sequence[_Column], room: int) -> list[int]:
    """Return the widths at which the columns fit; the column that has most to give is made narrower first."""
    widths = [column.natural for column in columns]
    while sum(widths) + _GAP * (len(widths) - 1) > room:
        spare = [width - column.least for width, column in zip(widths, columns, strict=True)]
        most = max(spare)
        if most <= 0:  # a terminal that is narrower than two columns: words fold
            widest = widths.index(max(widths))
            if widths[widest] <= 1:
                break
            widths[widest] -= 1
        else:
            widths[spare.index(most)] -= 1
    return widths


def _longest_word(texts: Iterable[str]) -> int:
    return max((cell_len(word) for text in texts for word in text.split()), default=0)


def _text(marked: str) -> Text:
    """Return a line or a cell with its marks as styles."""
    plain = unmarked(marked) if marked.startswith("#") else marked
    if plain != marked:
        return Text(plain, style="bold")
    text, end = Text(), 0
    for found in MARKS.finditer(plain):
        text.append(plain[end : found.start()])
        kind = found.lastgroup or ""
        text.append(found[kind], style=_STYLES[kind])
        end = found.end()
    return text.append(plain[end:])


def _is_command(line: str) -> bool:
    """Return whether a line is a command, which a person copies: it must stay one line."""
    return line.strip().startswith("`") and line.strip().endswith("`")


def _box(rule: str) -> Box:
    empty = "    \n"
    return Box(f"{empty}{empty}{rule * 4}\n{empty}{empty}{empty}{empty}{empty}", ascii=True)
