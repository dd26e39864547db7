"""The figures of a report as a picture: the same layers on the same scales, drawn by matplotlib. Shell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.pictures.colours import BELIEF, CLOSING, FAINT, INK, OPENING, REFERENCE, STATUS
from positioner.pictures.files import save
from positioner.pictures.panels import HEAD, LABEL, NORMAL, dress, head, new_figure
from positioner.report.layers import Bars, Limit, Line, Marks, Whiskers

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path
    from typing import Any

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from positioner.report.chart import Chart
    from positioner.report.layers import Layer

_COLUMNS = 2
_ROW_IN, _HEAD_IN, _FOOT_IN, _GAP_IN = 2.6, 0.95, 0.62, 1.25
"""Heights in inches: of a panel, above the first row, below the last one, and between two rows."""
_LEFT_PT, _ABOVE_PT, _GAP = 30.0, 10.0, 0.02
"""Where the unit of the vertical axis stands, in points from its upper end; how far beside it the legend begins."""
_LINES: dict[str, dict[str, Any]] = {
    "now": {"color": INK, "lw": 1.6},
    "reference": {"color": REFERENCE, "lw": 5.0, "solid_capstyle": "round", "zorder": 1.0},
    "fit": {"color": INK, "lw": 1.1, "ls": (0, (4, 3))},
    "opening": {"color": OPENING, "lw": 1.6},
    "closing": {"color": CLOSING, "lw": 1.6},
    "spring": {"color": BELIEF, "lw": 1.6, "ls": ":"},
    "friction": {"color": BELIEF, "lw": 1.6, "ls": (0, (6, 4))},
}
_MARKS: dict[str, dict[str, Any]] = {
    "up": {"marker": "^", "color": INK, "ms": 7.0},
    "down": {"marker": "v", "color": INK, "markerfacecolor": "white", "ms": 7.0},
    "dot": {"marker": "o", "color": INK, "ms": 5.0},
}


def draw(path: Path, title: str, charts: Sequence[Chart]) -> None:
    """Draw the charts into `path`."""
    save(figure_of(title, charts), path)


def figure_of(title: str, charts: Sequence[Chart]) -> Figure:
    """Return the charts, two in a row, below the title."""
    rows = -(-len(charts) // _COLUMNS)
    height_in = _HEAD_IN + rows * _ROW_IN + (rows - 1) * _GAP_IN + _FOOT_IN
    figure = new_figure(height_in)
    panels = figure.subplots(rows, min(len(charts), _COLUMNS), squeeze=False)
    figure.subplots_adjust(
        left=0.065, right=0.985, top=1.0 - _HEAD_IN / height_in, bottom=_FOOT_IN / height_in, wspace=0.16,
        hspace=_GAP_IN / _ROW_IN,
    )  # fmt: skip
    for panel, chart in zip(panels.flat, charts, strict=False):
        _draw(panel, chart)
    for panel in panels.flat[len(charts) :]:
        panel.set_axis_off()
    head(figure, 0.065, ((title, HEAD, "bold", INK),))
    return figure


def _draw(panel: Axes, chart: Chart) -> None:
    x, y = chart.scales()
    dress(panel, grid="y")
    panel.set_xlim(x.low, x.high)
    panel.set_ylim(y.low, y.high)
    panel.set_xticks(range(len(chart.names)) if chart.names else x.ticks)
    panel.set_xticklabels(chart.names or [x.label(tick) for tick in x.ticks])
    panel.set_yticks(y.ticks, [y.label(tick) for tick in y.ticks])
    panel.set_title(chart.title, loc="left", fontsize=LABEL, fontweight="bold", color=INK, pad=22.0)
    panel.set_xlabel(chart.x_label, loc="right", fontsize=NORMAL)
    unit = panel.annotate(
        chart.y_label, (0.0, 1.0), xycoords="axes fraction", xytext=(-_LEFT_PT, _ABOVE_PT), fontsize=NORMAL,
        textcoords="offset points", va="center_baseline",
    )  # fmt: skip
    for layer in chart.layers:
        _layer(panel, layer)
    handles, labels = panel.get_legend_handles_labels()
    if labels:
        above = _ABOVE_PT / 72.0 / _ROW_IN
        begin = panel.transAxes.inverted().transform(unit.get_window_extent())[1][0] + _GAP
        panel.legend(
            handles, labels, ncols=len(labels), loc="center left", bbox_to_anchor=(begin, 1.0 + above),
            borderpad=0.0, borderaxespad=0.0, fontsize=NORMAL, frameon=False, handlelength=1.5, handletextpad=0.5,
            columnspacing=1.0,
        )  # fmt: skip


def _layer(panel: Axes, layer: Layer) -> None:
    label = layer.label or None
    match layer:
        case Line():
            panel.plot(layer.x, layer.y, label=label, clip_on=False, **_LINES[layer.style])
        case Marks():
            panel.plot(layer.x, layer.y, ls="none", label=label, clip_on=False, **_MARKS[layer.mark])
        case Whiskers():
            panel.vlines(layer.x, layer.low, layer.high, color=INK, lw=1.2, label=layer.label)
        case Bars():
            panel.stairs(layer.heights, layer.edges, fill=True, color=FAINT, label=label)
        case Limit():
            panel.axhline(layer.y, color=STATUS[layer.style], ls="--", lw=1.2, label=label)
