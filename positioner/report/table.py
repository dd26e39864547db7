"""A table of text, which every kind of report shows in its own way. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from collections.abc import Iterable


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text; the first columns name the row, the others mostly hold numbers, whose unit is in the head.

    Rows in `marked` stand out. Where a table is too wide it is split, and each part has the first `names` columns. In
    text, a cell may have `code` and **strong** words, as in Markdown.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    marked: frozenset[int] = frozenset()
    names: int = 1

    @classmethod
    def of(cls, head: Iterable[str], rows: Iterable[Iterable[str]], names: int = 1) -> Self:
        """Return the table of any rows."""
        return cls(tuple(head), tuple(tuple(row) for row in rows), names=names)
