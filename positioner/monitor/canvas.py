"""Lines drawn with the dots of Braille characters, two by four in each, or with plain characters. Pure."""

from __future__ import annotations

from itertools import groupby
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

DOTS_WIDE, DOTS_HIGH = 2, 4
_BRAILLE = 0x2800
NO_PLAIN: Mapping[str, str] = MappingProxyType({})
_BITS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
"""The bit of a dot by its column and row (Unicode, block Braille Patterns)."""


class Canvas:
    """A field of `width` × `height` characters; a character has the pen of its last dot."""

    def __init__(self, width: int, height: int) -> None:
        """Begin empty."""
        self.width, self.height = width, height
        self._bits = [[0] * width for _ in range(height)]
        self._pens: list[list[str]] = [[""] * width for _ in range(height)]

    def column(self, x: int, low: float, high: float, pen: str) -> None:
        """Draw the dots of column `x` from `low` to `high`, parts of the height from the bottom; cut at its edges."""
        dots = self.height * DOTS_HIGH
        first, last = (round((dots - 1) * part) for part in (low, high))
        if not 0 <= x < self.width * DOTS_WIDE:
            return
        for dot in range(max(first, 0), min(last, dots - 1) + 1):
            row, rest = divmod(dots - 1 - dot, DOTS_HIGH)
            self._bits[row][x // DOTS_WIDE] |= _BITS[x % DOTS_WIDE][rest]
            self._pens[row][x // DOTS_WIDE] = pen

    def series(
        self,
        points: Sequence[tuple[float, float] | None],
        pen: str,
        *,
        dashed: bool = False,
        parted: Collection[int] = (),
    ) -> None:
        """Draw a range for each column of dots, and a line between them, but for columns in `parted`, or dashes."""
        before: tuple[int, float] | None = None
        for x, point in enumerate(points):
            if point is None:
                continue
            low, high = point
            if before is not None and not dashed and x not in parted:
                self._bridge(before, (x, low if abs(low - before[1]) < abs(high - before[1]) else high), pen)
            if not dashed or x // DOTS_WIDE % 2:
                self.column(x, low, high, pen)
            before = x, (low + high) / 2.0

    def _bridge(self, start: tuple[int, float], end: tuple[int, float], pen: str) -> None:
        wide = end[0] - start[0]
        for step in range(1, wide + 1):
            one = start[1] + (end[1] - start[1]) * (step - 1) / wide
            other = start[1] + (end[1] - start[1]) * step / wide
            self.column(start[0] + step, min(one, other), max(one, other), pen)

    def rows(self, plain: Mapping[str, str] = NO_PLAIN) -> list[list[tuple[str, str]]]:
        """Return each row as runs of text with their pens; `plain` has characters of the pens, in place of Braille."""
        found = []
        for bits, pens in zip(self._bits, self._pens, strict=True):
            cells = zip(bits, pens, strict=True)
            runs = groupby(cells, key=lambda cell: cell[1] if cell[0] else "")
            found.append([("".join(_character(bits, plain.get(pen)) for bits, _ in run), pen) for pen, run in runs])
        return found


def _character(bits: int, plain: str | None) -> str:
    if not bits:
        return " "
    return plain or chr(_BRAILLE + bits)
