"""The picture of single moves, `moves.png`: one panel a move, its time axis in ms. Shell, because it writes a file.

A panel shows position, speed and current of one move, with what the law knew when it began: its prediction, the movable
bound of the speed, the bounds of the current and the breakaway current Γ.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from positioner.bench.move_panels import DASH_DOT, PREDICTED, draw_move
from positioner.bench.moves import TELLING_OF_SPAN
from positioner.bench.trend import title
from positioner.pictures.colours import (
    BELIEF,
    BOUND,
    BREAKAWAY,
    COMMAND,
    FAINT,
    INK,
    MEASURED,
    POSITION,
    SETPOINT,
)
from positioner.pictures.files import save
from positioner.pictures.panels import HEAD, LABEL, NORMAL, head, new_figure

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from positioner.bench.moves import MovesData


MOST_MOVES = 6
"""Moves in the picture."""
_COLUMNS = 3
_ROW_IN, _HEAD_IN, _FOOT_IN = 4.5, 1.5, 0.5
_LEFT, _RIGHT = 0.065, 0.985
_BOUND, _GAMMA = "bound of the plan", "Γ"


def draw_moves(path: Path, data: MovesData) -> None:
    """Write the picture to `path`, a PNG of 1600 pixels, and as SVG beside it."""
    save(moves_figure(data), path)


def moves_figure(data: MovesData) -> Figure:
    """Return the picture."""
    columns = min(_COLUMNS, max(len(data.shown), 1))
    rows = -(-len(data.shown) // columns)
    height_in = _HEAD_IN + _FOOT_IN + _ROW_IN * max(rows, 1)
    figure = new_figure(height_in)
    lines = ((title(data.trend.scenario), HEAD, "bold", INK), (_told(data), LABEL, "normal", INK))
    head(figure, _LEFT, lines)
    if not data.shown:
        figure.text(0.5, 0.5, "the stem did not move", ha="center", fontsize=HEAD, color=INK)
        return figure
    grid = figure.add_gridspec(
        rows, columns, left=_LEFT, right=_RIGHT, top=1.0 - _HEAD_IN / height_in,
        bottom=_FOOT_IN / height_in, hspace=0.24, wspace=0.2,
    )  # fmt: skip
    for number, window in enumerate(data.shown):
        row, column = divmod(number, columns)
        cell = grid[row, column].subgridspec(3, 1, height_ratios=(1.7, 1.0, 1.15), hspace=0.1)
        position = figure.add_subplot(cell[0])
        panels = [position, *(figure.add_subplot(cell[place], sharex=position) for place in (1, 2))]
        draw_move(panels, data, window, data.predicted[number], names=column == 0)
        if row == rows - 1 or number + columns >= len(data.shown):
            panels[-1].set_xlabel("time since the stem began to move, ms", fontsize=LABEL)
    _legend(figure, data, 1.0 - 0.72 / height_in)
    return figure


def _told(data: MovesData) -> str:
    """Return which moves the picture shows, and how many it leaves out."""
    left = data.count - len(data.shown)
    if not left:
        return f"every move of the run: {data.count}"
    small_mm = TELLING_OF_SPAN * data.trend.span_m * 1e3
    return f"{len(data.shown)} of {data.count} moves: the first ones of at least {small_mm:.2g} mm; {left} left out"


def _legend(figure: Figure, data: MovesData, top: float) -> None:
    """Write what every line is, once for all panels, but for what no panel has."""
    trend = data.trend
    bounds = trend.velocity_lower_m_per_s, trend.velocity_upper_m_per_s, trend.current_lower_ma, trend.current_upper_ma
    missing = set() if any(each is not None for each in bounds) else {_BOUND}
    missing |= set() if data.breakaways else {_GAMMA}
    signs = (
        (Line2D([], [], color=POSITION, linewidth=2.0), "true"),
        (Line2D([], [], color=MEASURED, marker=".", markersize=7.0, linestyle=""), "measured"),
        (Line2D([], [], color=SETPOINT, linewidth=1.0), "setpoint"),
        (Patch(color=FAINT), "± 1 % of span"),
        (
            Line2D([], [], color=BELIEF, linewidth=2.0, linestyle=PREDICTED),
            "predicted at the move's start; speed estimate",
        ),
        (Line2D([], [], color=COMMAND, linewidth=1.6), "command"),
        (Line2D([], [], color=BOUND, linewidth=2.6, alpha=0.8), _BOUND),
        (Line2D([], [], color=BREAKAWAY, linewidth=1.6, linestyle=DASH_DOT), _GAMMA),
    )
    shown = [each for each in signs if each[1] not in missing]
    figure.legend(
        [sign for sign, _ in shown], [text for _, text in shown], loc="upper left", bbox_to_anchor=(_LEFT - 0.008, top),
        ncols=len(shown), frameon=False, fontsize=NORMAL, columnspacing=1.2, handlelength=1.8, borderpad=0.0,
    )  # fmt: skip
