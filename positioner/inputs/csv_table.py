"""A table of numbers from a text file that any program wrote: its delimiter, header, columns. Shell: it reads a file.

Commas, semicolons, tabs or blanks may separate the cells; a decimal comma is understood where no comma separates. Lines
that begin with # are comments. Cells without a number become NaN, and are counted.
"""

from __future__ import annotations

import io
import math
import re
from array import array
from collections import deque
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING

from positioner.errors import RecordError
from positioner.inputs.plain_file import MOST_MIB, read_plainly

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

_DELIMITERS = (";", "\t", ",", "|")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_LOOKED_AT = 50
_MOST_BYTES = 1 << 28
_BYTES_PER_BYTE = 32
"""Memory that a table takes for a byte of its file, with its diagnosis: 24 where it was measured."""


@dataclass(frozen=True, slots=True)
class Column:
    """One column: its name, its cells as they stand, and the line of the first one."""

    name: str
    cells: Sequence[str]


@dataclass(frozen=True, slots=True)
class CsvTable:
    """The columns of a file; lines: the number of the line in the file for each row; uneven: lines left out of them.

    A line below the first row that has more or fewer cells than the rows is left out.
    """

    source: str
    columns: tuple[Column, ...]
    lines: Sequence[int]
    uneven: Sequence[int] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the columns."""
        return tuple(column.name for column in self.columns)


def table_in(path: Path, otherwise: str = "", most_mib: int = MOST_MIB) -> CsvTable:
    """Return the table in a file, which may take `most_mib` of memory.

    otherwise: as for `text_of`.

    Raises:
        RecordError: the file cannot be read, holds no table, or is too large.
    """
    most_bytes = (most_mib << 20) // _BYTES_PER_BYTE
    try:
        data = read_plainly(path, most_bytes)
    except OSError as error:
        raise RecordError(f"{path}: cannot be read: {error.strerror}") from error
    if len(data) > most_bytes:
        text = f"is larger than {most_bytes / 2**20:.1f} MiB, and would take more than {most_mib} MiB of memory"
        raise RecordError(f"{path}: {text}: give a part of it, or allow more by --max-size")
    return read_table(str(path), text_of(str(path), data, otherwise))


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
    last = [line for _, line in deque(_lines(text), _LOOKED_AT)]
    if not last:
        raise RecordError(f"{source}: holds no line of a table")
    delimiter = _delimiter(last)
    width = round(median(len(_cells(line, delimiter)) for line in last))
    head: list[str] | None = None
    before: tuple[int, list[str]] | None = None
    columns: tuple[list[str], ...] = tuple([] for _ in range(width))
    kept, uneven = array("q"), array("q")
    for number, line in _lines(text):
        cells = _cells(line, delimiter)
        if not kept and (len(cells) != width or _numbers(cells) < min(2, width)):
            head = cells if head is None and len(cells) == width and any(cells) else head
            before = number, cells
        elif len(cells) != width:
            uneven.append(number)
        else:
            kept.append(number)
            for column, cell in zip(columns, cells, strict=True):
                column.append(cell)
    if not kept:
        raise RecordError(
            f"{source}: holds no row of at least two numbers: is it a CSV file? (A bus log needs --config.)"
        )
    if before and delimiter == "," and head is None and 1 < len(before[1]) < width:
        text = f"{source}: line {before[0]} has {len(before[1])} cells, and the rows have {width}"
        raise RecordError(f"{text}: are the commas decimal ones, too? Save it with semicolons between the cells")
    seen: dict[str, int] = {}
    named = []
    for index, found in enumerate(columns):
        name = (head[index] if head else "").strip() or str(index + 1)
        seen[name] = seen.get(name, 0) + 1
        named.append(Column(name if seen[name] == 1 else f"{name}.{seen[name]}", found))
    return CsvTable(source, tuple(named), kept, uneven)


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield the lines that are neither empty nor a comment, one at a time: a list of them would take much memory."""
    for number, line in enumerate(io.StringIO(text, newline=None), 1):
        bare = line.rstrip("\n")
        if bare.strip() and not bare.lstrip().startswith("#"):
            yield number, bare


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
