"""A table of numbers from a text file that any program wrote: its delimiter, its header, its columns. Pure.

Commas, semicolons, tabs or blanks may separate the cells; a decimal comma is understood where no comma separates. Lines
that begin with # are comments. Cells without a number become NaN, and are counted.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from statistics import median

from positioner.errors import RecordError

_DELIMITERS = (";", "\t", ",", "|")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_LOOKED_AT = 50
_MOST_BYTES = 1 << 28


@dataclass(frozen=True, slots=True)
class Column:
    """One column: its name, its cells as they stand, and the line of the first one."""

    name: str
    cells: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class CsvTable:
    """The columns of a file; lines: the number of the line in the file for each row; uneven: lines left out of them.

    A line below the first row that has more or fewer cells than the rows is left out.
    """

    source: str
    columns: tuple[Column, ...]
    lines: tuple[int, ...]
    uneven: tuple[int, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the columns."""
        return tuple(column.name for column in self.columns)


def text_of(source: str, data: bytes, otherwise: str = "") -> str:
    """Return the text of a file: UTF-8 or UTF-16 with or without its mark, else Latin-1.

    otherwise: what may be given in place of a text, for the message.

    Raises:
        RecordError: it is no text, or too large.
    """
    if len(data) > _MOST_BYTES:
        raise RecordError(f"{source}: is larger than {_MOST_BYTES >> 20} MiB: give a part of it")
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        encodings: tuple[str, ...] = ("utf-16",)
    elif b"\0" in data[:4096]:
        raise RecordError(f"{source}: is no text: a CSV file is needed{otherwise}")
    else:
        encodings = ("utf-8-sig", "latin-1")
    for encoding in encodings:
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    raise RecordError(f"{source}: is no text that can be read: save it as UTF-8")


def read_table(source: str, text: str) -> CsvTable:
    """Return the table in `text`; without a header the columns are called by their numbers, from 1.

    Raises:
        RecordError: there are no rows of numbers in it, or commas are both decimal and between the cells.
    """
    numbered = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    numbered = [(number, line) for number, line in numbered if not line.lstrip().startswith("#")]
    if not numbered:
        raise RecordError(f"{source}: holds no line of a table")
    delimiter = _delimiter([line for _, line in numbered[-_LOOKED_AT:]])
    rows = [(number, _cells(line, delimiter)) for number, line in numbered]
    width = round(median(len(cells) for _, cells in rows[-_LOOKED_AT:]))
    full = [len(cells) == width and _numbers(cells) >= min(2, width) for _, cells in rows]
    begin = full.index(True) if any(full) else None
    if begin is None:
        raise RecordError(
            f"{source}: holds no row of at least two numbers: is it a CSV file? (A bus log needs --config.)"
        )
    heads = [cells for _, cells in rows[:begin] if len(cells) == width and any(cells)]
    if begin and delimiter == "," and not heads and 1 < len(rows[begin - 1][1]) < width:
        number, cells = rows[begin - 1]
        text = f"{source}: line {number} has {len(cells)} cells, and the rows have {width}"
        raise RecordError(f"{text}: are the commas decimal ones, too? Save it with semicolons between the cells")
    names = heads[0] if heads else [str(number + 1) for number in range(width)]
    body = [(number, cells) for number, cells in rows[begin:] if len(cells) == width]
    seen: dict[str, int] = {}
    columns = []
    for index in range(width):
        name = names[index].strip() or str(index + 1)
        seen[name] = seen.get(name, 0) + 1
        unique = name if seen[name] == 1 else f"{name}.{seen[name]}"
        columns.append(Column(unique, tuple([row[index] for _, row in body])))
    uneven = tuple([number for number, cells in rows[begin:] if len(cells) != width])
    return CsvTable(source, tuple(columns), tuple([number for number, _ in body]), uneven)


def number_in(cell: str) -> float:
    """Return the number in a cell, with a decimal point or comma, or NaN; infinity is no number."""
    text = cell.strip().strip('"').strip().removesuffix("%").strip()
    if _DECIMAL_COMMA.fullmatch(text):
        text = text.replace(",", ".")
    try:
        value = float(text.replace("_", "x"))
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def _delimiter(lines: list[str]) -> str:
    """Return what separates the cells: what gives the same number of cells, of two or more, in most lines."""
    best, most = "", 0
    for each in (*_DELIMITERS, ""):
        widths = [len(_cells(line, each)) for line in lines]
        usual = max(set(widths), key=widths.count)
        agree = widths.count(usual) if usual > 1 else 0
        if agree > most:
            best, most = each, agree
    return best


def _cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line; a delimiter inside quotes separates nothing."""
    if not delimiter:
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    parts = re.split(rf'{re.escape(delimiter)}(?=(?:[^"]*"[^"]*")*[^"]*$)', line)
    return [cell.strip().strip('"').strip() for cell in parts]


def _numbers(cells: list[str]) -> int:
    return sum(not math.isnan(number_in(cell)) for cell in cells)
