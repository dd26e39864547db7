"""A small chart as SVG: lines, bands, marks, bars and limits on two axes; its colours are the page's. Pure.

Our own, not matplotlib's: a chart is a tenth of the size, has the page's fonts and colours, and needs no import of a
second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from markupsafe import Markup, escape

from positioner.report.scale import Scale, scale

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_HEIGHT = 214.0
_WIDTHS = {"half": 372.0, "wide": 768.0, "third": 246.0}
_LEFT, _RIGHT, _TOP, _BOTTOM = 50.0, 10.0, 24.0, 36.0
_TICK_EVERY_X, _TICK_EVERY_Y = 62.0, 34.0
_LETTER, _SWATCH = 5.8, 20.0


@dataclass(frozen=True, slots=True)
class Line:
    """A line through points; `style` is `now`, `reference` or `fit`. A number that is none parts it."""

    x: Sequence[float]
    y: Sequence[float]
    label: str = ""
    style: str = "now"


@dataclass(frozen=True, slots=True)
class Marks:
    """Points; `mark` is `up`, `down` (triangles) or `dot`."""

    x: Sequence[float]
    y: Sequence[float]
    label: str = ""
    mark: str = "dot"


@dataclass(frozen=True, slots=True)
class Band:
    """The area between two lines: an interval."""

    x: Sequence[float]
    low: Sequence[float]
    high: Sequence[float]
    label: str = ""


@dataclass(frozen=True, slots=True)
class Bars:
    """A histogram: `heights[i]` between `edges[i]` and `edges[i + 1]`."""

    edges: Sequence[float]
    heights: Sequence[float]
    label: str = ""


@dataclass(frozen=True, slots=True)
class Limit:
    """A level that must not be passed; `style` is that of the NE 107 status behind it."""

    y: float
    label: str
    style: str


Layer: TypeAlias = Line | Marks | Band | Bars | Limit


@dataclass(frozen=True, slots=True)
class Chart:
    """The layers, the first one at the back; `size` is `half`, `third` or `wide`, a part of the column.

    `names` stand below the axis in place of numbers, at 0, 1, 2.
    """

    title: str
    x_label: str
    y_label: str
    layers: tuple[Layer, ...]
    from_zero: bool = False
    size: str = "half"
    names: tuple[str, ...] = ()

    def svg(self) -> Markup:
        """Return the SVG element."""
        width = _WIDTHS[self.size]
        is_histogram = any(isinstance(layer, Bars) for layer in self.layers)
        across = round((width - _LEFT) / _TICK_EVERY_X)
        x = scale(_xs(self.layers), _LEFT, width - _RIGHT, across, tight=is_histogram)
        if self.names:
            x = Scale(-0.5, len(self.names) - 0.5, _LEFT, width - _RIGHT, 1.0)
        plot = _HEIGHT - _BOTTOM - _TOP
        y = scale(_ys(self.layers), _HEIGHT - _BOTTOM, _TOP, round(plot / _TICK_EVERY_Y), from_zero=self.from_zero)
        content = [*_axes(self, x, y), *(part for layer in self.layers for part in _drawn(layer, x, y))]
        content += _legend(self.layers, len(self.y_label) * _LETTER + 14.0)
        place = f'viewBox="0 0 {width:g} {_HEIGHT:g}" preserveAspectRatio="xMinYMid"'
        head = f'<svg class="chart" {place} role="img" aria-label="{escape(self.title)}">'
        return Markup("\n".join([head, *content, "</svg>"]))  # noqa: S704 - every text in it is escaped


def _xs(layers: tuple[Layer, ...]) -> Iterator[float]:
    for layer in layers:
        if isinstance(layer, Bars):
            yield from layer.edges
        elif not isinstance(layer, Limit):
            yield from layer.x


def _ys(layers: tuple[Layer, ...]) -> Iterator[float]:
    for layer in layers:
        match layer:
            case Bars():
                yield from (0.0, *layer.heights)
            case Band():
                yield from (*layer.low, *layer.high)
            case Limit():
                yield layer.y
            case _:
                yield from layer.y


def _axes(chart: Chart, x: Scale, y: Scale) -> Iterator[str]:
    for tick in y.ticks:
        level = y.at(tick)
        yield f'<path class="grid" d="M{x.begin:g} {level:.1f}H{x.end:g}"/>'
        yield _text(x.begin - 6.0, level + 4.0, y.label(tick), "end")
    named = [(float(number), name) for number, name in enumerate(chart.names)]
    for tick, name in named or [(tick, x.label(tick)) for tick in x.ticks]:
        yield _text(x.at(tick), y.begin + 15.0, name, "middle")
    yield f'<path class="axis" d="M{x.begin:g} {y.begin:g}H{x.end:g}"/>'
    yield _text(x.end, _HEIGHT - 5.0, chart.x_label, "end")
    yield _text(0.0, 11.0, chart.y_label, "start")


def _text(x: float, y: float, text: str, anchor: str, style: str = "") -> str:
    kind = f' class="{style}"' if style else ""
    return f'<text{kind} x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'


def _drawn(layer: Layer, x: Scale, y: Scale) -> Iterator[str]:
    match layer:
        case Line():
            yield f'<path class="{layer.style}" d="{_path(layer.x, layer.y, x, y)}"/>'
        case Band():
            there = _path(layer.x, layer.high, x, y)
            back = _path(layer.x[::-1], layer.low[::-1], x, y).replace("M", "L", 1)
            yield f'<path class="band" d="{there}{back}Z"/>'
        case Bars():
            for left, right, height in zip(layer.edges[:-1], layer.edges[1:], layer.heights, strict=True):
                begin, end, level = x.at(left) + 0.5, x.at(right) - 0.5, y.at(height)
                size = f'width="{max(end - begin, 0.5):.1f}" height="{y.at(0.0) - level:.1f}"'
                yield f'<rect class="bar" x="{begin:.1f}" y="{level:.1f}" {size}/>'
        case Marks():
            for across, up in zip(layer.x, layer.y, strict=True):
                if math.isfinite(up):
                    yield _mark(layer.mark, x.at(across), y.at(up))
        case Limit():
            level = y.at(layer.y)
            yield f'<path class="limit {layer.style}" d="M{x.begin:g} {level:.1f}H{x.end:g}"/>'
            yield _text(x.end, level - 3.0, layer.label, "end", "limit-name")


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
    return f'<circle class="dot" cx="{x:.1f}" cy="{y:.1f}" r="2.4"/>'


def _legend(layers: tuple[Layer, ...], at: float) -> Iterator[str]:
    """Yield a swatch and a name for each layer that has one, in the row above the axes, from the place `at` on."""
    for layer in layers:
        if isinstance(layer, Limit) or not layer.label:
            continue
        match layer:
            case Line():
                yield f'<path class="{layer.style}" d="M{at + 2:.1f} 7.5h14"/>'
            case Marks():
                yield _mark(layer.mark, at + 10.0, 7.5)
            case Band() | Bars():
                style = "band" if isinstance(layer, Band) else "bar"
                yield f'<rect class="{style}" x="{at + 2:.1f}" y="3" width="14" height="9"/>'
        yield _text(at + _SWATCH, 11.0, layer.label, "start")
        at += _SWATCH + 10.0 + _LETTER * len(layer.label)
