"""Elements of every panel of a picture: the figure, lines in steps, fitting limits, names at the right. Pure drawing.

Every figure is `WIDTH_IN` wide, so that it is 1200 pixels wide on a screen of 96 dpi, and a size of text in points is
what a reader sees there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from positioner.pictures.colours import FAINT, INK, MEASURED
from positioner.pictures.curves import envelope

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

WIDTH_IN = 12.5
DPI = 128
SMALL, NORMAL, LABEL, HEAD = 9.0, 9.5, 10.5, 14.0
"""Sizes of text in points, none below 9: of notes and ticks, of names, of axes and of the title."""
_ROW = 13.5
"""Points between two names."""
_BESIDE = 1.008
"""Where the names begin, as a part of the panel."""


def new_figure(height_in: float) -> Figure:
    """Return a figure of the one width, white."""
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def dress(panel: Axes, *, grid: Literal["", "x", "y", "both"] = "") -> None:
    """Give a panel the look of all: two spines, ticks in the colour of text, a faint grid along `grid` (x, y, both)."""
    panel.spines[["top", "right"]].set_visible(False)
    panel.spines[["left", "bottom"]].set_color(MEASURED)
    panel.tick_params(colors=INK, labelsize=SMALL)
    if grid:
        panel.grid(axis=grid, color=FAINT, linewidth=0.6)
        panel.set_axisbelow(True)


def line(
    panel: Axes,
    time_s: Array,
    values: Array,
    colour: str,
    *,
    width: float,
    alpha: float = 1.0,
    zorder: float = 4.0,
    style: str = "-",
) -> None:
    """Draw `values` (n,) over `time_s` (n,) in steps: a bound that is active for a single sample is visible."""
    panel.plot(
        *envelope(time_s, values), color=colour, linewidth=width, alpha=alpha, drawstyle="steps-post", zorder=zorder,
        linestyle=style,
    )  # fmt: skip


def fit(panel: Axes, curves: list[Array], percentiles: tuple[float, float]) -> None:
    """Set the limits so that these percentiles of every curve with values are inside, with a margin."""
    known = [curve[np.isfinite(curve)] for curve in curves]
    inside = np.array([np.percentile(values, percentiles) for values in known if len(values)])
    if not len(inside):
        return
    low, high = float(inside.min()), float(inside.max())
    margin = 0.2 * (high - low) or 1.0
    panel.set_ylim(low - margin, high + margin)


LINE, DOT, BLOCK, DOWN, CROSS = "▬", "●", "■", "▼", "✕"
"""The signs of names: a line, a dashed one, dots, an area, marks."""


def name(panel: Axes, names: Sequence[tuple[str, str, str]], below: int = 0) -> None:
    """Write the names of what a panel shows at its right: sign, its colour, name; under `below` other ones."""
    for row, (sign, colour, words) in enumerate(names, start=below):
        for text, ink, right in ((sign, colour, 0.0), (words, INK, 14.0)):
            panel.annotate(
                text, (_BESIDE, 0.97), xycoords="axes fraction", xytext=(right, -_ROW * row),
                textcoords="offset points", color=ink, fontsize=NORMAL, va="top",
            )  # fmt: skip


def head(figure: Figure, left: float, lines: Sequence[tuple[str, float, str, str]], top_in: float = 0.3) -> None:
    """Write lines of (text, size, weight, colour) from the top of the figure; one that is too long becomes smaller.

    At the smallest size it is cut.
    """
    width_in, height_in = figure.get_size_inches()
    room = (0.99 - left) * width_in * figure.dpi
    for text, size, weight, colour in lines:
        place = (left, 1.0 - top_in / height_in)
        written = figure.text(*place, text, fontsize=size, fontweight=weight, color=colour, va="center")
        written.set_fontsize(max(size * min(1.0, room / written.get_window_extent().width), SMALL))
        shown = len(text)
        while written.get_window_extent().width > room:
            shown -= 1
            written.set_text(f"{text[:shown].rstrip()}…")
        top_in += 1.55 * size / 72.0
