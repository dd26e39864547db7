"""A small chart as SVG: two axes, the layers on them, a legend. Its fonts and colours are the page's. Pure.

Our own, not matplotlib's: a chart is a fifth of the size, takes its look from the page, also in print, and needs no
import that takes a second.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from positioner.report.layers import Bars, text
from positioner.report.scale import Scale, scale

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.report.layers import Layer

_HEIGHT = 176.0
_WIDTHS = {"half": 372.0, "wide": 768.0, "third": 246.0}
_LEFT, _RIGHT, _TOP, _BOTTOM = 50.0, 10.0, 24.0, 36.0
_TICK_EVERY_X, _TICK_EVERY_Y = 62.0, 28.0
_LETTER, _SWATCH, _ROW = 5.8, 18.0, 14.0
_ROOM = 0.05
"""Of what the values span: the room above and below them on a tight scale."""


@dataclass(frozen=True, slots=True)
class Chart:
    """The layers, the first one at the back; `size` is `half`, `third` or `wide`, a part of the column.

    `names` stand below the axis in place of numbers, at 0, 1, 2. from_zero: of the vertical axis; tight: the axes end
    with the values, the vertical one with a little room around them, and not at round numbers beyond.
    """

    title: str
    x_label: str
    y_label: str
    layers: tuple[Layer, ...]
    from_zero: bool = False
    size: str = "half"
    names: tuple[str, ...] = ()
    tight: bool = False

    def svg(self) -> Markup:
        """Return the SVG element."""
        width = _WIDTHS[self.size]
        legend, rows = _legend(self.layers, max(len(self.y_label) * _LETTER + 14.0, 40.0), width)
        x, y = self.scales(_TOP + (rows - 1) * _ROW)
        content = [*_axes(self, x, y), *(part for layer in self.layers for part in layer.drawn(x, y)), *legend]
        place = f'viewBox="0 0 {width:g} {_HEIGHT:g}" preserveAspectRatio="xMinYMid"'
        head = f'<svg class="chart" {place} role="img" aria-label="{escape(self.title)}">'
        return Markup("\n".join([head, *content, "</svg>"]))  # noqa: S704 - every text in it is escaped

    def scales(self, top: float = _TOP) -> tuple[Scale, Scale]:
        """Return both scales, in the units of the SVG, below `top`."""
        width = _WIDTHS[self.size]
        is_histogram = any(isinstance(layer, Bars) for layer in self.layers)
        xs = [each for layer in self.layers for each in layer.xs()]
        across = round((width - _LEFT) / _TICK_EVERY_X)
        x = scale(xs, _LEFT, width - _RIGHT, across, tight=is_histogram or self.tight)
        if self.names:
            x = Scale(-0.5, len(self.names) - 0.5, _LEFT, width - _RIGHT, 1.0)
        ys = [each for layer in self.layers for each in layer.ys()]
        up = round((_HEIGHT - _BOTTOM - top) / _TICK_EVERY_Y) + self.tight  # its ends have no tick
        y = scale(ys, _HEIGHT - _BOTTOM, top, up, from_zero=self.from_zero, tight=self.tight)
        if self.tight:
            room = _ROOM * (y.high - y.low)
            y = Scale(y.low - room, y.high + room, y.begin, y.end, y.step)
        return x, y


def _axes(chart: Chart, x: Scale, y: Scale) -> Iterator[str]:
    for tick in y.ticks:
        level = y.at(tick)
        yield f'<path class="grid" d="M{x.begin:g} {level:.1f}H{x.end:g}"/>'
        yield text(x.begin - 6.0, level + 4.0, y.label(tick), "end")
    named = [(float(number), name) for number, name in enumerate(chart.names)]
    for tick, name in named or [(tick, x.label(tick)) for tick in x.ticks]:
        inside = x.end + _RIGHT - 0.5 * _LETTER * len(name)
        yield text(min(x.at(tick), inside), y.begin + 15.0, name, "middle")
    yield f'<path class="axis" d="M{x.begin:g} {y.begin:g}H{x.end:g}"/>'
    yield text(x.end, _HEIGHT - 5.0, chart.x_label, "end")
    yield text(0.0, 11.0, chart.y_label, "start")


def _legend(layers: tuple[Layer, ...], begin: float, width: float) -> tuple[list[str], int]:
    """Return a sign and a name for each layer that has one, above the axes from `begin` on, and their rows."""
    drawn, at, row = list[str](), begin, 0
    for layer in layers:
        if layer.label:
            wide = _SWATCH + 12.0 + _LETTER * len(layer.label)
            if at > begin and at + wide - 12.0 > width:
                at, row = begin, row + 1
            sign, name = layer.swatch(at), text(at + _SWATCH, 11.0, layer.label, "start")
            drawn.append(f'<g transform="translate(0 {row * _ROW:g})">{sign}{name}</g>' if row else sign + name)
            at += wide
    return drawn, row + 1
