"""What a chart shows on its two axes: each layer knows its values, and draws itself as SVG. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from markupsafe import escape

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from positioner.report.scale import Scale

_NAME = 11.0
"""The height of a limit's name."""


class Layer(Protocol):
    """One part of a chart."""

    @property
    def label(self) -> str:
        """The name in the legend, empty for none."""

    def xs(self) -> Sequence[float]:
        """Return the values that the horizontal axis must hold."""

    def ys(self) -> Sequence[float]:
        """Return the values that the vertical axis must hold."""

    def drawn(self, x: Scale, y: Scale) -> Iterator[str]:
        """Yield the SVG elements."""

    def swatch(self, at: float) -> str:
        """Return the sign in the legend, 14 wide, at this place of its row."""


@dataclass(frozen=True, slots=True)
class _Points:
    """Points, of which a layer makes something."""

    x: Sequence[float]
    y: Sequence[float]
    label: str = ""

    def xs(self) -> Sequence[float]:
        """Return the places of the points."""
        return self.x

    def ys(self) -> Sequence[float]:
        """Return the values of the points."""
        return self.y


@dataclass(frozen=True, slots=True)
class Line(_Points):
    """A line through points; a number that is none parts it.

    style: `now`, `reference` or `fit`; of a loop `opening` and `closing`, its `spring`, and that with `friction`.
    """

    style: str = "now"

    def drawn(self, x: Scale, y: Scale) -> Iterator[str]:
        """Yield the line."""
        yield f'<path class="{self.style}" d="{_path(self.x, self.y, x, y)}"/>'

    def swatch(self, at: float) -> str:
        """Return a short line."""
        return f'<path class="{self.style}" d="M{at:.1f} 7.5h14"/>'


@dataclass(frozen=True, slots=True)
class Marks(_Points):
    """Points; `mark` is `up`, `down` (triangles) or `dot`."""

    mark: str = "dot"

    def drawn(self, x: Scale, y: Scale) -> Iterator[str]:
        """Yield a mark for each point."""
        for across, up in zip(self.x, self.y, strict=True):
            if math.isfinite(up):
                yield _mark(self.mark, x.at(across), y.at(up))

    def swatch(self, at: float) -> str:
        """Return one mark."""
        return _mark(self.mark, at + 8.0, 7.5)


@dataclass(frozen=True, slots=True)
class Whiskers:
    """An upright line from `low` to `high` at each place: the interval of a point; none where an end is no number."""

    x: Sequence[float]
    low: Sequence[float]
    high: Sequence[float]
    label: str = ""

    def xs(self) -> Sequence[float]:
        """Return the places."""
        return self.x

    def ys(self) -> Sequence[float]:
        """Return the ends of the intervals."""
        return [*self.low, *self.high]

    def drawn(self, x: Scale, y: Scale) -> Iterator[str]:
        """Yield the upright lines."""
        for across, low, high in zip(self.x, self.low, self.high, strict=True):
            if not (math.isfinite(low) and math.isfinite(high)):
                continue
            yield f'<path class="whisker" d="M{x.at(across):.1f} {y.at(low):.1f}V{y.at(high):.1f}"/>'

    def swatch(self, at: float) -> str:
        """Return one of them."""
        return f'<path class="whisker" d="M{at + 7.0:.1f} 2.5v10"/>'


@dataclass(frozen=True, slots=True)
class Bars:
    """A histogram: `heights[i]` between `edges[i]` and `edges[i + 1]`."""

    edges: Sequence[float]
    heights: Sequence[float]
    label: str = ""

    def xs(self) -> Sequence[float]:
        """Return the edges."""
        return self.edges

    def ys(self) -> Sequence[float]:
        """Return the heights, and 0 where they stand."""
        return [0.0, *self.heights]

    def drawn(self, x: Scale, y: Scale) -> Iterator[str]:
        """Yield the bars."""
        for left, right, height in zip(self.edges[:-1], self.edges[1:], self.heights, strict=True):
            begin, end, level = x.at(left) + 0.5, x.at(right) - 0.5, y.at(height)
            size = f'width="{max(end - begin, 0.5):.1f}" height="{y.at(0.0) - level:.1f}"'
            yield f'<rect class="bar" x="{begin:.1f}" y="{level:.1f}" {size}/>'

    def swatch(self, at: float) -> str:
        """Return a small bar."""
        return f'<rect class="bar" x="{at:.1f}" y="3" width="14" height="9"/>'


@dataclass(frozen=True, slots=True)
class Limit:
    """A level that must not be passed; `style` is that of the NE 107 status behind it, `name` stands on the line."""

    y: float
    name: str
    style: str
    label: str = ""

    def xs(self) -> Sequence[float]:
        """Return nothing: it goes from end to end."""
        return ()

    def ys(self) -> Sequence[float]:
        """Return the level."""
        return (self.y,)

    def drawn(self, x: Scale, y: Scale) -> Iterator[str]:
        """Yield the line and its name."""
        level = y.at(self.y)
        yield f'<path class="limit {self.style}" d="M{x.begin:g} {level:.1f}H{x.end:g}"/>'
        beside = level - 3.0 if level > y.end + _NAME else level + _NAME  # the legend is above the axes
        yield text(x.begin + 4.0, beside, self.name, "start", "limit-name")

    def swatch(self, at: float) -> str:
        """Return a short line."""
        return f'<path class="limit {self.style}" d="M{at:.1f} 7.5h14"/>'


def text(x: float, y: float, words: str, anchor: str, style: str = "") -> str:
    """Return a text element; `anchor` is the end of it that stands at the place."""
    kind = f' class="{style}"' if style else ""
    return f'<text{kind} x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(words)}</text>'


def _path(xs: Sequence[float], ys: Sequence[float], x: Scale, y: Scale) -> str:
    parts, letter = [], "M"
    for across, up in zip(xs, ys, strict=True):
        if math.isfinite(across) and math.isfinite(up):
            parts.append(f"{letter}{x.at(across):.1f} {y.at(up):.1f}")
            letter = "L"
        else:
            letter = "M"
    return "".join(parts)


def _mark(mark: str, x: float, y: float) -> str:
    match mark:
        case "up":
            return f'<path class="dot" d="M{x:.1f} {y - 4.6:.1f}l4.4 7.6h-8.8z"/>'
        case "down":
            return f'<path class="hollow" d="M{x:.1f} {y + 4.6:.1f}l4.4 -7.6h-8.8z"/>'
    return f'<circle class="dot" cx="{x:.1f}" cy="{y:.1f}" r="2.6"/>'
