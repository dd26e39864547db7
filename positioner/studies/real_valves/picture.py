"""The picture of the league on real valves: error by lag, and settling against the limit. Pure drawing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from positioner.studies.real_valves.goals import LOW
from positioner.studies.real_valves.valves import NOISE_NAMES, NOMINAL

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from matplotlib.axes import Axes

    from positioner.studies.real_valves.results import Cell, Results

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8B5E3C", "#999999")
_MARKS = ("o", "s", "^", "v", "D", "P", "X", "<")
_INK = "#222222"


def draw(path: Path, results: Results) -> None:
    """Write the picture: a line for each law on the nominal valve; a dwell that never settles gives no point."""
    nominal = [cell for cell in results.chosen() if cell.plant == NOMINAL]
    noises = list(dict.fromkeys(cell.noise for cell in nominal))
    figure = Figure(figsize=(5.2 * (len(noises) + 1), 6.0), dpi=110)
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(noises) + 1, squeeze=False)[0]
    for panel, noise in zip(panels, noises, strict=False):
        _draw(panel, results, [cell for cell in nominal if cell.noise == noise], lambda cell: cell.mean_pct)
        panel.set_title(f"mean error, noise {NOISE_NAMES[noise]}", loc="left", fontweight="bold")
        panel.set_ylabel("mean |error| of the last half second, % of span")
    speed = panels[-1]
    _draw(speed, results, [cell for cell in nominal if cell.noise == LOW], _settle_ms)
    optimum = [results.optimal_settle_s[lag_s] * 1e3 for lag_s in results.lags_s]
    speed.plot(range(len(optimum)), optimum, color=_INK, linestyle="--", linewidth=1.4, label="time-optimal")
    speed.set_title(f"speed, noise {NOISE_NAMES[LOW]}", loc="left", fontweight="bold")
    speed.set_ylabel("median settling to 1 %, ms")
    handles, labels = speed.get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, ncols=len(labels), loc="lower center", fontsize=9)
    figure.suptitle("The nominal valve by the lag of its actuator", x=0.01, ha="left")
    figure.tight_layout(rect=(0.0, 0.05, 1.0, 1.0))
    figure.savefig(path)


def _draw(panel: Axes, results: Results, cells: list[Cell], figure: Callable[[Cell], float | None]) -> None:
    places = {lag_s: place for place, lag_s in enumerate(results.lags_s)}
    for index, law in enumerate(dict.fromkeys(cell.law for cell in cells)):
        points = [(places[cell.lag_s], figure(cell)) for cell in cells if cell.law == law]
        known = sorted((place, value) for place, value in points if value is not None)
        panel.plot(
            [place for place, _ in known],
            [value for _, value in known],
            color=_COLOURS[index % len(_COLOURS)],
            marker=_MARKS[index % len(_MARKS)],
            linewidth=2.2 if index == 0 else 1.1,
            markersize=5,
            label=law,
        )
    panel.set_yscale("log")
    panel.set_xticks(range(len(places)), [f"{lag_s * 1e3:g}" for lag_s in places])
    panel.set_xlabel("lag of the actuator, ms")
    panel.grid(axis="y", color="#DDDDDD", linewidth=0.6)
    panel.spines[["top", "right"]].set_visible(False)


def _settle_ms(cell: Cell) -> float | None:
    return None if cell.median_settle_1pct_s is None else cell.median_settle_1pct_s * 1e3
