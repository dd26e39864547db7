"""The picture of the league on real valves: error by lag, and settling against the limit. Pure drawing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from positioner.pictures.colours import INK, MARKS, SERIES
from positioner.pictures.panels import HEAD, LABEL, NORMAL, dress, head, new_figure
from positioner.studies.real_valves.goals import LOW
from positioner.studies.real_valves.valves import NOISE_NAMES, NOMINAL

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from positioner.studies.real_valves.results import Cell, Results


_DODGE = 0.3
"""Room for the laws beside each other at one lag, so that equal figures do not hide each other."""


def real_valves_figure(results: Results) -> Figure:
    """Return the picture: a line for each law on the nominal valve; a dwell that never settles gives no point."""
    nominal = [cell for cell in results.chosen() if cell.plant == NOMINAL]
    noises = list(dict.fromkeys(cell.noise for cell in nominal))
    laws = list(dict.fromkeys(cell.law for cell in nominal))
    figure = new_figure(5.6)
    panels = figure.subplots(1, len(noises) + 1, squeeze=False)[0]
    figure.subplots_adjust(left=0.065, right=0.985, top=0.86, bottom=0.2, wspace=0.24)
    for panel, noise in zip(panels, noises, strict=False):
        _draw(panel, results, laws, [cell for cell in nominal if cell.noise == noise], lambda cell: cell.mean_pct)
        panel.set_title(f"mean error, noise {NOISE_NAMES[noise]}", loc="left", fontsize=LABEL, fontweight="bold")
    panels[0].set_ylabel("mean |error| of the last half second, % of span", fontsize=LABEL)
    speed = panels[-1]
    _draw(speed, results, laws, [cell for cell in nominal if cell.noise == LOW], _settle_ms)
    optimum = [results.optimal_settle_s[lag_s] * 1e3 for lag_s in results.lags_s]
    speed.plot(range(len(optimum)), optimum, color=INK, linestyle="--", linewidth=1.6, label="time-optimal")
    speed.set_title(f"speed, noise {NOISE_NAMES[LOW]}", loc="left", fontsize=LABEL, fontweight="bold")
    speed.set_ylabel("median settling to 1 %, ms", fontsize=LABEL)
    found: dict[str, Any] = {}
    for panel in panels:
        handles, labels = panel.get_legend_handles_labels()
        found |= dict(zip(labels, handles, strict=True))
    figure.legend(
        list(found.values()), list(found), frameon=False, ncols=min(len(found), 8), loc="lower center", fontsize=NORMAL,
        bbox_to_anchor=(0.5, 0.0),
    )  # fmt: skip
    head(figure, 0.065, (("The nominal valve by the lag of its actuator", HEAD, "bold", INK),))
    return figure


def _draw(
    panel: Axes, results: Results, laws: Sequence[str], cells: list[Cell], figure: Callable[[Cell], float | None]
) -> None:
    places = {lag_s: place for place, lag_s in enumerate(results.lags_s)}
    for index, law in enumerate(laws):
        points = [(places[cell.lag_s], figure(cell)) for cell in cells if cell.law == law]
        known = sorted((place, value) for place, value in points if value is not None)
        dodge = _DODGE * ((index + 0.5) / len(laws) - 0.5)
        if known:
            panel.plot(
                [place + dodge for place, _ in known],
                [value for _, value in known],
                color=SERIES[index % len(SERIES)],
                marker=MARKS[index % len(MARKS)],
                linewidth=2.4 if index == 0 else 1.2,
                markersize=5.5,
                label=law,
            )
    dress(panel, grid="y")
    panel.set_yscale("log")
    panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.yaxis.set_minor_formatter(NullFormatter())
    panel.set_xticks(range(len(places)), [f"{lag_s * 1e3:g}" for lag_s in places])
    panel.set_xlabel("lag of the actuator, ms", fontsize=LABEL)


def _settle_ms(cell: Cell) -> float | None:
    return None if cell.median_settle_1pct_s is None else cell.median_settle_1pct_s * 1e3
